#!/usr/bin/env bash
# Builds the image and runs a job through it, also where no image registry is reachable: the base
# image is stood in for by a Debian made here with debootstrap and this machine's Rust toolchain,
# tagged with the name that the Dockerfile uses. Package sources, certificates and cargo settings
# are those of this machine and go into the stand-in only. Needs root.
set -euo pipefail
cd "$(dirname "$0")/.."

suite=bookworm
port=${IMAGE_CHECK_PORT:-18099}
cache=${IMAGE_CHECK_CACHE:-/var/tmp/medialrep-image-check}
image=localhost/medialrep:check
work=$(mktemp -d)
server=

say() { printf 'image-check: %s\n' "$*"; }
fail() { say "FAILED: $*"; exit 1; }
images() { buildah --root "$cache/storage" --runroot "$cache/run" --storage-driver vfs "$@"; }
in_image() { images run --isolation chroot --volume "$work/share:/share" "$container" -- "$@"; }
field() { sed -n "s/.*\"$1\":\"\\([^\"]*\\)\".*/\\1/p" | head -1; }

clean_up() {
    if [ -n "$server" ]; then stop_server 2>/dev/null || true; fi
    images rm --all >/dev/null 2>&1 || true
    rm -rf "$work"
}
trap clean_up EXIT

need_tools() {
    local missing=()
    for tool in buildah debootstrap curl; do command -v "$tool" >/dev/null || missing+=("$tool"); done
    [ ${#missing[@]} -eq 0 ] && return
    [ "$(id -u)" = 0 ] || fail "needs root, and ${missing[*]}"
    apt-get update -q >/dev/null && DEBIAN_FRONTEND=noninteractive apt-get install -qy "${missing[@]}" >/dev/null
}

mirror() {
    apt-get indextargets --format '$(SITE) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' 2>/dev/null |
        awk -v suite="$suite" '$2 == suite && $3 == "main" { print $1; exit }'
}

# The Rust image: Debian, a C compiler, and the toolchain of this machine.
make_stand_in() {
    local name=$1 root=$cache/root-$suite from=$(mirror)
    if [ ! -e "$root/complete" ]; then
        say "making a Debian $suite"
        rm -rf "$root"
        debootstrap --variant=minbase --include=ca-certificates,gcc,libc6-dev "$suite" "$root" \
            "${from:-http://deb.debian.org/debian}" >"$work/debootstrap.log" ||
            { tail -5 "$work/debootstrap.log"; fail "debootstrap"; }
        touch "$root/complete"
    fi
    say "making a stand-in for $name"
    images rmi --force "$name" >/dev/null 2>&1 || true
    container=$(images from scratch)
    images copy --quiet "$container" "$root" / >/dev/null
    images copy --quiet "$container" "$(rustc --print sysroot)" /usr/local/rust >/dev/null
    images copy --quiet "$container" /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/ca-certificates.crt >/dev/null
    local settings=${CARGO_HOME:-$HOME/.cargo}/config.toml
    if [ -e "$settings" ]; then images copy --quiet "$container" "$settings" /usr/local/cargo/config.toml >/dev/null; fi
    images config --env PATH=/usr/local/rust/bin:/usr/bin:/bin --env CARGO_HOME=/usr/local/cargo "$container"
    images commit --quiet --rm "$container" "$name" >/dev/null
}

build() {
    say "building $image"
    images build --isolation chroot --pull-never --format docker --tag "$image" . >"$work/build.log" 2>&1 ||
        { tail -30 "$work/build.log"; fail "build"; }
    size=$(images images --format '{{.Size}}' --filter reference="$image")
    user=$(images inspect --type image --format '{{.Docker.Config.User}}' "$image")
    [[ $user =~ ^[1-9][0-9]*(:[1-9][0-9]*)?$ ]] || fail "the user of the image is '$user', not a number other than 0"
}

wait_ready() {
    for _ in $(seq 100); do
        if curl -sf "http://127.0.0.1:$port/readyz" >/dev/null; then return; fi
        kill -0 "$server" 2>/dev/null || break
        sleep 0.1
    done
    tail -5 "$work/server.log"
    fail "the service does not get ready"
}

# The service is the last in a row of single children.
stop_server() {
    local process=$server child
    while child=$(pgrep --parent "$process" | head -1) && [ -n "$child" ]; do process=$child; done
    kill -TERM "$process"
    wait "$server" || true
    server=
}

run_job() {
    local url=http://127.0.0.1:$port answer id state
    answer=$(curl -s --fail-with-body --data-binary "@$work/share/sample.nii.gz" "$url/v1/jobs") || fail "the job is not accepted: $answer"
    id=$(field id <<<"$answer")
    for _ in $(seq 300); do
        state=$(curl -sf "$url/v1/jobs/$id" | field state)
        case $state in queued | running) sleep 0.1 ;; *) break ;; esac
    done
    [ "$state" = succeeded ] || { curl -s "$url/v1/jobs/$id"; fail "the job has $state"; }
    for name in model.glb thickness.json thickness.csv points.csv; do
        curl -sf -o "$work/$name" "$url/v1/jobs/$id/results/$name" || fail "no $name"
        [ -s "$work/$name" ] || fail "$name is empty"
    done
    curl -sf -X DELETE "$url/v1/jobs/$id" || fail "the job cannot be deleted"
}

start_in_buildah() {
    say "starting it with buildah"
    in_image /medialrep serve --listen "127.0.0.1:$port" >"$work/server.log" 2>&1 &
    server=$!
    wait_ready
    in_image /medialrep probe --listen "127.0.0.1:$port" || fail "the health check of the image says no"
}

# As docker run --read-only: the root cannot be written to, only /data. Random numbers need /dev.
start_read_only() {
    say "starting it on a read-only root"
    unshare --mount bash -c '
        mkdir -p "$1/dev" && mount --bind "$1" "$1" && mount -o remount,ro,bind "$1" || exit 9
        mount --rbind /dev "$1/dev" && mount --bind "$2" "$1/data" || exit 9
        ! touch "$1/written" 2>/dev/null || exit 8
        exec chroot --userspec=65532:65532 "$1" /medialrep serve --listen "127.0.0.1:$3" --data-dir /data
    ' - "$mounted" "$work/data" "$port" >"$work/server.log" 2>&1 &
    server=$!
    wait_ready
}

need_tools
mkdir -p "$cache" "$work/data" "$work/share"
base=$(sed -n 's/^FROM \([^ ]*\) AS build$/\1/p' Dockerfile)
make_stand_in "$base"
build
chown 65532:65532 "$work/data" "$work/share"
container=$(images from --pull-never "$image")
in_image /medialrep sample "${IMAGE_CHECK_SAMPLE:-ellipsoid}" --out /share/sample.nii.gz
mounted=$(images mount "$container")
find "$mounted" | sort >"$work/before"
start_in_buildah
run_job
stop_server
find "$mounted" | sort >"$work/after"
diff "$work/before" "$work/after" || fail "something was written outside of /data"
start_read_only
run_job
[ "$(stat -c %u "/proc/$server")" = 65532 ] || fail "the service does not run as 65532"
stop_server
say "passed: $size, user $user, a job on a read-only root"

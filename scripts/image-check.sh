#!/usr/bin/env bash
# Builds the image, looks at its page and runs a job through it, also where no image registry is
# reachable: the base images are stood in for by a Debian made here with debootstrap, with this
# machine's Rust toolchain and with its Node.js, tagged with the names that the Dockerfile uses.
# Package sources, certificates, cargo and npm settings are those of this machine and go into the
# stand-ins only. Needs root, Node.js and npm.
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
    for tool in node npm; do command -v "$tool" >/dev/null || fail "needs $tool"; done
    for tool in buildah debootstrap curl; do command -v "$tool" >/dev/null || missing+=("$tool"); done
    [ ${#missing[@]} -eq 0 ] && return
    [ "$(id -u)" = 0 ] || fail "needs root, and ${missing[*]}"
    apt-get update -q >/dev/null && DEBIAN_FRONTEND=noninteractive apt-get install -qy "${missing[@]}" >/dev/null
}

mirror() {
    apt-get indextargets --format '$(SITE) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' 2>/dev/null |
        awk -v suite="$suite" '$2 == suite && $3 == "main" { print $1; exit }'
}

# What the Dockerfile builds the stage of this name on.
base_of() { sed -n "s/^FROM \([^ ]*\) AS $1\$/\1/p" Dockerfile; }

# Whether this stand-in was made before, with the same tools.
is_made() {
    [ "$(images inspect --type image --format '{{index .Docker.Config.Labels "toolchain"}}' "$1" 2>/dev/null)" = "$2" ]
}

put() { images copy --quiet "$container" "$1" "$2" >/dev/null; }

# A container of Debian with a C compiler and this machine's certificates.
begin_stand_in() {
    local name=$1 root=$cache/root-$suite from
    from=$(mirror)
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
    put "$root" /
    put /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/ca-certificates.crt
}

# The Rust image: the toolchain of this machine.
make_rust_stand_in() {
    local name=$1 toolchain settings=${CARGO_HOME:-$HOME/.cargo}/config.toml
    toolchain=$(rustc -V)
    if is_made "$name" "$toolchain"; then return; fi
    begin_stand_in "$name"
    put "$(rustc --print sysroot)" /usr/local/rust
    if [ -e "$settings" ]; then put "$settings" /usr/local/cargo/config.toml; fi
    images config --env PATH=/usr/local/rust/bin:/usr/bin:/bin --env CARGO_HOME=/usr/local/cargo \
        --label "toolchain=$toolchain" "$container"
    images commit --quiet --rm "$container" "$name" >/dev/null
}

# The Node.js image: node and npm of this machine.
make_node_stand_in() {
    local name=$1 toolchain tree=$work/node settings
    toolchain="node $(node -v), npm $(npm -v 2>/dev/null)"
    if is_made "$name" "$toolchain"; then return; fi
    mkdir -p "$tree/usr/bin" "$tree/usr/lib/node_modules" "$tree/root"
    cp "$(readlink -f "$(command -v node)")" "$tree/usr/bin/node"
    cp -a "$(dirname "$(dirname "$(readlink -f "$(command -v npm)")")")" "$tree/usr/lib/node_modules/npm"
    ln -s ../lib/node_modules/npm/bin/npm-cli.js "$tree/usr/bin/npm"
    settings=$(npm config get userconfig 2>/dev/null)
    if [ -e "$settings" ]; then cp "$settings" "$tree/root/.npmrc"; fi
    begin_stand_in "$name"
    put "$tree" /
    images config --env PATH=/usr/bin:/bin --env HOME=/root \
        --env NODE_EXTRA_CA_CERTS=/etc/ssl/certs/ca-certificates.crt \
        --env NPM_CONFIG_CAFILE=/etc/ssl/certs/ca-certificates.crt \
        --env "NPM_CONFIG_REGISTRY=$(npm config get registry 2>/dev/null)" \
        --label "toolchain=$toolchain" "$container"
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

look_at_page() {
    local url=http://127.0.0.1:$port page
    page=$(curl -sf --header 'Accept: text/html' "$url/") || fail "no page"
    [[ $page == *page.js* ]] || fail "the page is not built into the image: $page"
    for name in page.js viewer.js; do
        curl -sf -o "$work/$name" "$url/$name" || fail "no $name"
        [ -s "$work/$name" ] || fail "$name is empty"
    done
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
make_rust_stand_in "$(base_of build)"
make_node_stand_in "$(base_of web)"
build
chown 65532:65532 "$work/data" "$work/share"
container=$(images from --pull-never "$image")
in_image /medialrep sample "${IMAGE_CHECK_SAMPLE:-ellipsoid}" --out /share/sample.nii.gz
mounted=$(images mount "$container")
find "$mounted" | sort >"$work/before"
start_in_buildah
look_at_page
run_job
stop_server
find "$mounted" | sort >"$work/after"
diff "$work/before" "$work/after" || fail "something was written outside of /data"
start_read_only
run_job
[ "$(stat -c %u "/proc/$server")" = 65532 ] || fail "the service does not run as 65532"
stop_server
say "passed: $size, user $user, the page, a job on a read-only root"

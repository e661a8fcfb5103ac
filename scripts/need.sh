#!/usr/bin/env bash
# need.sh "make run" curl node rust …: looks whether this machine has what a step needs, and fetches
# what the step would download. What is missing ends it with one sentence that says what to do; nothing
# is built here. Name what is looked at on this machine before what comes over the network.
set -u -o pipefail
cd "$(dirname "$0")/.."

step=$1
shift
log=$(mktemp)
trap 'rm -f "$log"' EXIT

fail() { echo "$step: $*" >&2; exit 1; }
has() { command -v "$1" >/dev/null; }
# Whether version $1 is $2 or later.
is_since() { printf '%s\n%s\n' "$2" "$1" | sort -t. -k1,1n -k2,2n -k3,3n -c 2>/dev/null; }

# Runs a command without its words; tells $1 once its words have $2 in them. All are in $log.
quietly() {
    local what=$1 sign=$2
    shift 2
    "$@" 2>&1 | tee "$log" | { if grep -q -i -m1 "$sign"; then echo "$what"; fi; cat >/dev/null; }
}

need_curl() { has curl || fail "curl is missing: install it (Debian: apt-get install curl)"; }

need_c() {
    local compiler=${CC:-cc} program status=0
    program=$(mktemp)
    # It may be there without headers or linker.
    # shellcheck disable=SC2086
    $compiler -x c -o "$program" - >"$log" 2>&1 <<<$'#include <stdlib.h>\nint main(void) { return EXIT_SUCCESS; }' || status=$?
    rm -f "$program"
    [ $status = 0 ] ||
        fail "a C compiler that works is missing ($compiler): install one (Debian: apt-get install gcc libc6-dev; macOS: xcode-select --install)"
}

# What package.json allows: versions as ^20.19 or >=24, divided by ||.
need_node() {
    local allowed words found part least is_allowed=
    local get="install Node.js 22 or 24 with npm from https://nodejs.org"
    allowed=$(sed -n 's/.*"node": *"\(.*\)".*/\1/p' web/package.json)
    words=$(sed 's/ || / or /g; s/\^//g; s/>=\([0-9.]*\)/\1 and later/g' <<<"$allowed")
    has node || fail "Node.js is missing: $get"
    found=$(node --version 2>"$log" | sed 's/^v//')
    [ -n "$found" ] || fail "Node.js does not start (node --version): $get"
    for part in ${allowed//||/ }; do
        least=${part//[^0-9.]/}
        # ^ stays within the major version.
        if [ "${part:0:1}" = '^' ] && [ "${found%%.*}" != "${least%%.*}" ]; then continue; fi
        if is_since "$found" "$least"; then is_allowed=1; fi
    done
    [ -n "$is_allowed" ] || fail "Node.js $found cannot build the page ($words can; a system's own package is often too old): $get"
    has npm || fail "npm is missing, which comes with Node.js: $get"
}

need_rust() {
    local least wanted found get="install it with rustup, https://rustup.rs"
    least=$(sed -n 's/^rust-version = "\(.*\)"$/\1/p' Cargo.toml)
    wanted=$(sed -n 's/^channel = "\(.*\)"$/\1/p' rust-toolchain.toml)
    has cargo && has rustc || fail "Rust is missing (cargo and rustc): $get"
    # With rustup this fetches the version that is wanted.
    if ! quietly "fetching Rust $wanted ..." "^info: downloading" cargo --version; then
        fail "Rust $wanted is not on this machine and was not fetched: check the network, then run rustup toolchain install $wanted"
    fi
    found=$(rustc --version 2>"$log" | sed -n 's/^rustc \([0-9.]*\).*/\1/p')
    [ -n "$found" ] || fail "Rust does not start (rustc --version): $get"
    is_since "$found" "$least" || fail "Rust $found is too old, $least or later is needed: $get"
}

need_browser() {
    local get="install it (Debian: apt-get install chromium), or name one in MEDIALREP_BROWSER"
    if [ -n "${MEDIALREP_BROWSER:-}" ] || has chromium || has google-chrome; then return; fi
    [ "$(id -u)" = 0 ] && has apt-get || fail "Chromium is missing, in which the page is tested: $get"
    quietly "installing Chromium ..." "^Get:" install_chromium ||
        fail "Chromium is missing, in which the page is tested, and apt-get cannot fetch it: check the network, or $get"
}

install_chromium() {
    apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends chromium
}

need_page_packages() { fetch_packages web "what the page is built with"; }
need_test_packages() { fetch_packages tests/tools "what the tests are made with"; }

fetch_packages() {
    local folder=$1 what=$2 lock=$1/package-lock.json installed=$1/node_modules/.package-lock.json
    if [ -e "$installed" ] && ! [ "$lock" -nt "$installed" ]; then return; fi
    npm_answers "$folder"
    echo "fetching $what ..."
    (cd "$folder" && npm ci --loglevel=error --no-fund --no-audit) >"$log" 2>&1 ||
        fail "npm ci in $folder failed, try it there: $(sed -n 's/^npm [Ee][Rr][^ ]* *//p' "$log" | head -2 | paste -s -d' ')"
}

# Any answer will do: not every registry knows this question.
npm_answers() {
    local code
    (cd "$1" && npm ping --fetch-retries=0 --fetch-timeout=15000) >"$log" 2>&1 && return
    code=$(sed -n 's/^npm .* code \([A-Z_0-9]*\)$/\1/p' "$log" | head -1)
    [[ $code =~ ^E[0-9]+$ ]] ||
        fail "npm's registry does not answer (${code:-npm ping failed}): check the network, its proxy and what npm config get registry says"
}

need_crates() { fetch_crates --edges no-dev; }
need_test_crates() { fetch_crates; }

# cargo tree needs what a build needs.
fetch_crates() {
    local host
    cargo tree --locked --offline "$@" >"$log" 2>&1 && return
    host=$(rustc -vV | sed -n 's/^host: //p')
    CARGO_NET_RETRY=${CARGO_NET_RETRY:-1} CARGO_TERM_COLOR=never CARGO_TERM_QUIET=false \
        quietly "fetching what the program is built with ..." downloaded cargo fetch --locked --target "$host" && return
    grep -q "lock file" "$log" && fail "Cargo.lock does not fit Cargo.toml: run cargo build, and see what changed in it"
    fail "cargo cannot fetch what the program is built with: check the network, its proxy and the registry in cargo's config.toml ($(tail -1 "$log" | sed 's/^ *//'))"
}

for thing in "$@"; do "need_${thing//-/_}"; done

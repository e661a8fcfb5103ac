#!/usr/bin/env bash
# Runs the recipe of examples/orthanc on a real Orthanc, of Debian's packages: orthanc-check.sh [short|long]. They are
# installed where MEDIALREP_MAY_INSTALL=1 says so. Where it cannot be run it is left out with a word.
# MEDIALREP_PROGRAM names a program that is built already.
set -uo pipefail
cd "$(dirname "$0")/.."

packages=(orthanc orthanc-dicomweb orthanc-python dcmtk iproute2 python3)
plugins=/usr/share/orthanc/plugins
# A mirror that hangs must not hold up everything else. The packages are about 30 MB.
install_seconds=240
log=$(mktemp)
policy=
trap 'rm -f "$log" $policy' EXIT

leave_out() {
    echo "left out: orthanc-check: $*"
    if [ -n "${MEDIALREP_LEFT_OUT:-}" ]; then echo "left out: orthanc-check: $*" >>"$MEDIALREP_LEFT_OUT"; fi
    exit 0
}

is_there() {
    command -v Orthanc >/dev/null && command -v ip >/dev/null && command -v python3 >/dev/null &&
        [ -e $plugins/libOrthancDicomWeb.so ] && [ -e $plugins/libOrthancPython.so ]
}

# Debian starts what it installs, and Orthanc would listen on all addresses.
keep_from_starting() {
    [ -e /usr/sbin/policy-rc.d ] && return
    policy=/usr/sbin/policy-rc.d
    printf '#!/bin/sh\nexit 101\n' >$policy && chmod 755 $policy
}

install() {
    echo "installing Orthanc ..."
    keep_from_starting
    export DEBIAN_FRONTEND=noninteractive
    timeout $install_seconds apt-get install -qy --no-install-recommends "${packages[@]}" >"$log" 2>&1 ||
        { timeout $install_seconds apt-get update -q >"$log" 2>&1 &&
            timeout $install_seconds apt-get install -qy --no-install-recommends "${packages[@]}" >"$log" 2>&1; }
    # Nor when the machine is started again.
    if command -v systemctl >/dev/null; then systemctl disable orthanc >/dev/null 2>&1; fi
}

if ! is_there; then
    [ "${MEDIALREP_MAY_INSTALL:-}" = 1 ] ||
        leave_out "Orthanc is not installed, and MEDIALREP_MAY_INSTALL=1 does not say that it may be (Debian: apt-get install ${packages[*]})"
    [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null || leave_out "Orthanc can be installed by root on Debian only"
    install
    is_there || leave_out "apt-get cannot fetch Orthanc: $(tail -1 "$log")"
fi
unshare --net true 2>/dev/null || unshare --map-root-user --net true 2>/dev/null ||
    leave_out "this machine makes no network of its own (unshare --net)"

if [ -z "${MEDIALREP_PROGRAM:-}" ]; then
    cargo build --locked --release --quiet || exit 1
    MEDIALREP_PROGRAM=${CARGO_TARGET_DIR:-target}/release/medialrep
fi
MEDIALREP=$(realpath "$MEDIALREP_PROGRAM") examples/orthanc/check.sh "${1:-short}"

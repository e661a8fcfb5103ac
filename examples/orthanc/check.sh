#!/usr/bin/env bash
# Tries the recipe on this machine's Orthanc: the three hooks side by side, each with an Orthanc, a service and a
# network of its own. A line per case; ends with 1 when a case failed. MEDIALREP names the program.
#
# usage: check.sh [short|long] [lua|stow|python ...]     short takes a minute or two, long twelve to thirty
set -uo pipefail
here=$(cd "$(dirname "$0")" && pwd)
length=${1:-short}
shift || true
if [ $# = 0 ]; then set -- lua stow python; fi
hooks=("$@")
case $length in
short) seconds=480 ;;
long) seconds=3600 ;;
*) echo "check.sh: short or long" >&2 && exit 2 ;;
esac

work=$(mktemp -d)
checks=()
# A check ends what it started when it is told to stop.
clean_up() {
    for check in "${checks[@]}"; do kill "$check" 2>/dev/null; done
    wait
    rm -rf "$work"
}
trap clean_up EXIT
trap 'exit 1' INT TERM

# Nothing of this is seen from outside, and no port is taken: a network that has its loopback alone.
network=(unshare --net)
"${network[@]}" true 2>/dev/null || network=(unshare --map-root-user --net)
for hook in "${hooks[@]}"; do
    timeout --kill-after=10 "$seconds" "${network[@]}" \
        sh -c 'ip link set lo up && exec python3 "$0" "$@"' "$here/check.py" "$length" "$hook" "$work/$hook" &
    checks+=($!)
done
failed=0
for check in "${checks[@]}"; do wait "$check" || failed=1; done
checks=()
if [ $failed = 1 ]; then
    echo "orthanc: the ends of the logs:"
    tail -n 25 "$work"/*/*.log
fi
exit $failed

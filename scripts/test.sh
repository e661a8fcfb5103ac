#!/usr/bin/env bash
# Runs all tests and counts them. Installs what they need beyond Rust, Node.js and a C compiler.
set -uo pipefail
cd "$(dirname "$0")/.."

scripts/need.sh "make test" node rust c browser page-packages test-packages test-crates || exit 1
# The page is tested in it.
browser=${MEDIALREP_BROWSER:-$(command -v chromium || command -v google-chrome)}
make --no-print-directory web || exit 1
echo "building the program and its tests ... (the first time this takes some minutes)"
cargo test --locked --no-run --quiet || exit 1

# Cargo hides what passing tests print, so tests append what they leave out to a file, a line for each.
log=$(mktemp)
left_out=$(mktemp)
trap 'rm -f "$log" "$left_out"' EXIT
export MEDIALREP_LEFT_OUT=$left_out

cargo test --locked --no-fail-fast "$@" 2>&1 | tee "$log"
status=$?
# Cargo counts these as passed, vitest does not.
not_passed=$(sort -u "$left_out" | wc -l)
if [ $# -eq 0 ]; then
    program=$(cargo build --locked --message-format=json 2>/dev/null | sed -n 's/.*"executable":"\([^"]*\/medialrep\)".*/\1/p')
    (cd web && MEDIALREP_PROGRAM=$program MEDIALREP_BROWSER=$browser NO_COLOR=1 npm test --silent) 2>&1 | tee -a "$log" || status=1
    MEDIALREP_PROGRAM=$program scripts/orthanc-check.sh 2>&1 | tee -a "$log" || status=1
else
    echo "left out: all tests of the page: a filter was given" >>"$left_out"
    echo "left out: orthanc-check: a filter was given" >>"$left_out"
fi
echo
sort -u "$left_out"
awk -v not_passed="$not_passed" -v left_out="$(sort -u "$left_out" | wc -l)" '
    /^test result:/ { passed += $4; failed += $6 }
    /^orthanc: ok:/ { passed += 1 }
    /^orthanc: FAILED:/ { failed += 1 }
    /^ +Tests / { for (i = 2; i <= NF; i++) { if ($i == "passed") passed += $(i - 1); if ($i == "failed") failed += $(i - 1) } }
    END { printf "\n%d passed, %d failed, %d left out\n", passed - not_passed, failed, left_out }
' "$log"
exit $status

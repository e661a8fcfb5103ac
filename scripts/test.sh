#!/usr/bin/env bash
# Runs all tests and counts them. Installs what they need beyond the Rust toolchain.
set -uo pipefail
cd "$(dirname "$0")/.."

# The validator of the glTF files is a Node package.
if [ -f tests/tools/package.json ]; then
    command -v npm >/dev/null || { echo "make test: needs Node.js with npm, for the glTF validator" >&2; exit 1; }
    (cd tests/tools && npm ci --silent --no-fund --no-audit) || exit 1
fi

log=$(mktemp)
trap 'rm -f "$log"' EXIT
cargo test --locked --no-fail-fast "$@" 2>&1 | tee "$log"
status=$?
awk '/^test result:/ { passed += $4; failed += $6 } END { printf "\n%d passed, %d failed\n", passed, failed }' "$log"
exit $status

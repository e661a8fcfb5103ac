#!/usr/bin/env bash
# Holds a running service against openapi.yaml with schemathesis, which is installed into target/.
set -euo pipefail
cd "$(dirname "$0")/.."

port=${CONTRACT_PORT:-18081}
tools=${CARGO_TARGET_DIR:-target}/contract
work=$(mktemp -d)
server=
trap 'if [ -n "$server" ]; then kill "$server" 2>/dev/null || true; fi; rm -rf "$work"' EXIT

cargo build --locked --release
program=${CARGO_TARGET_DIR:-target}/release/medialrep
[ -x "$tools/bin/schemathesis" ] || { python3 -m venv "$tools" && "$tools/bin/pip" install --quiet 'schemathesis>=4,<5'; }

"$program" sample slab --spacing 2 --out "$work/mask.nii.gz"
RUST_LOG=warn "$program" serve --listen "127.0.0.1:$port" --data-dir "$work/data" --min-free-mib 0 --max-queued 100000 &
server=$!
for _ in $(seq 100); do
    if curl -sf "http://127.0.0.1:$port/readyz" >/dev/null; then break; fi
    sleep 0.1
done
CONTRACT_MASK=$work/mask.nii.gz "$tools/bin/schemathesis" run "http://127.0.0.1:$port/openapi.yaml" \
    --max-examples "${CONTRACT_EXAMPLES:-100}" "$@"
curl -sf "http://127.0.0.1:$port/readyz" >/dev/null

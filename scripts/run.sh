#!/usr/bin/env bash
# Starts the service with a job already sent through its own API, and says what to try.
set -euo pipefail
cd "$(dirname "$0")/.."

listen=${MEDIALREP_LISTEN:-127.0.0.1:8080}
url=http://$listen
sample=${SAMPLE:-bent}

# A proxy has no way to this machine's own port.
curl() { command curl --noproxy '*' "$@"; }
fail() { echo "make run: $*" >&2; exit 1; }

scripts/need.sh "make run" curl node rust c page-packages crates
# curl says 7 when nobody listens.
status=0
curl -s -o /dev/null --max-time 5 "$url" || status=$?
[ $status = 7 ] || fail "something answers at $url already: stop it, or choose another port: MEDIALREP_LISTEN=127.0.0.1:8081 make run"

make --no-print-directory web
echo "building the program ... (the first time this takes some minutes)"
cargo build --release --locked --quiet
program=${CARGO_TARGET_DIR:-target}/release/medialrep
mkdir -p -m 700 data
mask=data/$sample.nii.gz
"$program" sample "$sample" --out "$mask"

RUST_LOG=${RUST_LOG:-warn} "$program" serve --listen "$listen" --data-dir data &
server=$!
trap 'kill "$server" 2>/dev/null; wait "$server" 2>/dev/null; exit 0' INT TERM
trap 'kill "$server" 2>/dev/null || true' EXIT

for _ in $(seq 100); do
    curl -sf "$url/readyz" >/dev/null && break
    kill -0 "$server" 2>/dev/null || { wait "$server"; exit 1; }
    sleep 0.1
done

job=$(curl -sf -D - -o /dev/null --data-binary "@$mask" \
    "$url/v1/jobs?labels=%7B%22sample%22%3A%22$sample%22%7D" | tr -d '\r' | sed -n 's/^[Ll]ocation: //p') || true
if [ -z "$job" ]; then
    echo "medialrep is running at $url. The sample was refused: if ./data has tokens, the page asks for one."
    wait "$server"
fi
state=queued
for _ in $(seq 300); do
    state=$(curl -sf "$url$job" | sed -n 's/.*"state":"\([a-z]*\)".*/\1/p')
    case $state in queued | running) sleep 0.1 ;; *) break ;; esac
done

cat <<END

medialrep is running. A sample ($sample) was sent; its job has $state. See it in a browser:
  $url/#/jobs/${job##*/}

Or try:
  curl $url$job                                        # the job: state, progress, results
  curl -OJ $url$job/results/model.glb                  # meshes, for any glTF viewer
  curl $url$job/results/thickness.json                 # sheets, surfaces, thickness vectors
  curl -i --data-binary @$mask $url/v1/jobs            # send a mask
  curl -F mask=@$mask -F 'params={"grid":"auto"}' $url/v1/jobs
  curl $url/v1/jobs                                    # all jobs
  curl -X DELETE $url$job                              # erase a job, its mask and results
  $url/docs                                            # all routes, to be tried out in a browser

Ctrl-C stops it; jobs stay in ./data.
END
wait "$server"

#!/usr/bin/env bash
# Both sides on this machine, to try the recipe: start.sh FOLDER [lua|stow|python]. Ctrl-C stops both.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "${1:?name a folder}"
folder=$(cd "$1" && pwd)
hook=${2:-lua}
orthanc_url=http://127.0.0.1:${ORTHANC_HTTP_PORT:-8042}

"$here/service.sh" "$folder" >"$folder/service.log" 2>&1 &
service=$!
for _ in $(seq 100); do
    if [ -s "$folder/token" ]; then break; fi
    kill -0 $service 2>/dev/null || { tail -5 "$folder/service.log" >&2 && exit 1; }
    sleep 0.1
done
"$here/orthanc.sh" "$folder" "$hook" >"$folder/orthanc.log" 2>&1 &
orthanc=$!
trap 'kill $service $orthanc 2>/dev/null; wait' EXIT
trap 'exit 0' INT TERM

cat <<END
Orthanc     $orthanc_url   user medialrep, password in $folder/password
medialrep   http://${MEDIALREP_LISTEN:-127.0.0.1:8080}   token in $folder/token
logs        $folder/orthanc.log, $folder/service.log
Send a segmentation:
  $here/make_seg.py one $folder/one.dcm
  curl -u "medialrep:\$(cat $folder/password)" --data-binary @$folder/one.dcm $orthanc_url/instances
END
wait -n $service $orthanc
echo "one of them has ended; see the logs" >&2
exit 1

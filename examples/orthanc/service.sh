#!/usr/bin/env bash
# Runs medialrep in the foreground for the Orthanc of orthanc.sh: service.sh FOLDER. MEDIALREP names the program. Makes
# the token and the password when they are not there.
set -euo pipefail
folder=${1:?name a folder} program=${MEDIALREP:-medialrep}
umask 077
mkdir -p "$folder"

# No character that would have to be escaped in JSON or in a URL.
[ -s "$folder/password" ] || head -c 18 /dev/urandom | base64 | tr '+/' '-_' >"$folder/password"
[ -s "$folder/credentials" ] || echo "medialrep:$(cat "$folder/password")" >"$folder/credentials"
[ -s "$folder/token" ] ||
    "$program" token create --tenant pacs --deliver-to orthanc --data-dir "$folder/service" >"$folder/token"

exec "$program" serve --listen "${MEDIALREP_LISTEN:-127.0.0.1:8080}" --data-dir "$folder/service" \
    --pacs "orthanc=http://127.0.0.1:${ORTHANC_HTTP_PORT:-8042}/dicom-web" \
    --pacs-credentials "orthanc=$folder/credentials"

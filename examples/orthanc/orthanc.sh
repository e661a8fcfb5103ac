#!/usr/bin/env bash
# Runs Orthanc in the foreground with one of the three hooks: orthanc.sh FOLDER lua|stow|python. What it keeps and its
# configuration are in FOLDER; service.sh, which makes the secrets, comes first.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
folder=${1:?name a folder} hook=${2:-lua}

plugins=/usr/share/orthanc/plugins
python=
case $hook in
lua) scripts="\"$here/medialrep.lua\"" ;;
stow) scripts="\"$here/medialrep.lua\", \"$here/medialrep_stow.lua\"" ;;
python) scripts= python=1 ;;
*) echo "orthanc.sh: the hook is lua, stow or python" >&2 && exit 2 ;;
esac

mkdir -p "$folder/db" "$folder/orthanc"
export ORTHANC_FOLDER=$folder MEDIALREP_TOKEN_FILE=$folder/token
ORTHANC_PASSWORD=$(cat "$folder/password") MEDIALREP_TOKEN=$(cat "$folder/token")
export ORTHANC_PASSWORD MEDIALREP_TOKEN

cp "$here/orthanc.json" "$folder/orthanc/orthanc.json"
cat >"$folder/orthanc/hook.json" <<JSON
{
  ${python:+"\"PythonScript\": \"$here/medialrep.py\","}
  "LuaScripts": [$scripts],
  "Plugins": ["$plugins/libOrthancDicomWeb.so"${python:+", \"$plugins/libOrthancPython.so\""}]
}
JSON
exec Orthanc "$folder/orthanc"

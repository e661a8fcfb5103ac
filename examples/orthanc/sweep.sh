#!/usr/bin/env bash
# The heart beat of the Lua hooks where Orthanc has none (before 1.11.1; Debian 12 has 1.10.1): an empty job, whose end
# Orthanc tells its scripts. sweep.sh URL FILE, where FILE holds USER:PASSWORD; run it once a minute.
set -euo pipefail
url=${1:?the URL of Orthanc} credentials=${2:?a file with USER:PASSWORD}
# By its standard input: the password must not be seen in the list of processes.
printf 'user = "%s"\n' "$(cat "$credentials")" |
    curl --config - --fail --silent --show-error --noproxy '*' --max-time 60 --output /dev/null \
        --data '{"Resources": [], "Asynchronous": true}' "${url%/}/tools/create-archive"

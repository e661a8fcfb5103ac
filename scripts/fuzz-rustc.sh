#!/usr/bin/env bash
# Stands in for rustc in `make fuzz`: instruments what reads foreign bytes and leaves the rest alone.
# Coverage of the database and of the executor changes from run to run and would fill the corpus. What
# is built for a build script has no --target, and no fuzzer to link with.
set -euo pipefail
shopt -s extglob
rustc=$1
shift
case " $* " in
*" --crate-name "@(medialrep|nifti|dicom|nrrd|metaimage|params|multipart|related|multer|httparse|serde_json|quick_xml|flate2|miniz_oxide)" "*" --target "*)
    set -- "$@" --cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
        -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
        -Cllvm-args=-sanitizer-coverage-trace-compares
    ;;
esac
exec "$rustc" "$@"

#!/usr/bin/env bash
# Fuzzes what reads foreign bytes: each target (all, or those named) for FUZZ_SECONDS, then what was
# found is merged into fuzz/corpus. Needs a C++ compiler. An input that breaks a target is kept in
# fuzz/artifacts; the target run on it alone shows what breaks.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=${FUZZ_SECONDS:-1800}
host=$(rustc -vV | sed -n 's/^host: //p')
build=${CARGO_TARGET_DIR:-target}/fuzz
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Forms and files go through a folder: in memory, where there is one.
if [ -w /dev/shm ]; then
    memory=$(mktemp -d -p /dev/shm)
    trap 'rm -rf "$work" "$memory"' EXIT
    export TMPDIR=$memory
fi

run() {
    local target=$1 found=$build/found/$1 seeds=$work/$1-seeds merged=$work/$1 before after
    mkdir -p "$found" "$seeds" "$merged" "fuzz/corpus/$target" "fuzz/artifacts/$target"
    local program=$build/$host/release/$target
    local options=(-max_len=4096 -timeout=10 -rss_limit_mb=2048 "-artifact_prefix=fuzz/artifacts/$target/")
    FUZZ_SEEDS=$seeds "$program" "${options[@]}" "-dict=fuzz/dictionaries/$target.dict" \
        "-max_total_time=$seconds" -print_final_stats=1 "$found" "$seeds" "fuzz/corpus/$target"
    # By edges alone, so that the corpus stays small.
    "$program" "${options[@]}" -set_cover_merge=1 -use_counters=0 "$merged" "fuzz/corpus/$target" "$seeds" "$found"
    before=$(find "fuzz/corpus/$target" -type f | wc -l)
    rm -rf "fuzz/corpus/$target"
    mv "$merged" "fuzz/corpus/$target"
    after=$(find "fuzz/corpus/$target" -type f | wc -l)
    echo "fuzz: $target: $before inputs in the corpus before, $after now"
}

RUSTC_WRAPPER=$PWD/scripts/fuzz-rustc.sh \
    cargo build --release --locked --manifest-path fuzz/Cargo.toml --target "$host" --target-dir "$build"
for target in "${@:-nifti dicom nrrd metaimage params multipart related}"; do
    for one in $target; do run "$one"; done
done

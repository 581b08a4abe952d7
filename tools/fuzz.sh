#!/usr/bin/env bash
# Fuzzes readers of files: tools/fuzz.sh SECONDS [TARGET...]; every target where none is named.
#
# Runs on the stable compiler (RUSTC_BOOTSTRAP lets it take libFuzzer's flags) with address sanitizer and a memory limit.
# Needs cargo-fuzz (`cargo install cargo-fuzz`) and a C++ compiler. What crashes is kept in fuzz/artifacts; what was found
# on the way in fuzz/corpus, of which git keeps the files named seed-*.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:?tools/fuzz.sh SECONDS [TARGET...]}
shift
export RUSTC_BOOTSTRAP=1
targets=("$@")
[ "${#targets[@]}" -gt 0 ] || mapfile -t targets < <(cargo fuzz list)
for target in "${targets[@]}"; do
    echo "== $target: $seconds s"
    words=()
    [ ! -f "fuzz/dictionaries/$target" ] || words=(-dict="fuzz/dictionaries/$target")
    cargo fuzz run --release "$target" -- -max_total_time="$seconds" -rss_limit_mb=1024 -malloc_limit_mb=512 -timeout=10 \
        -print_final_stats=1 "${words[@]}"
done

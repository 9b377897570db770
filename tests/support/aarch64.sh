#!/usr/bin/env bash
# The same ticks by the compiled core on this machine and on an emulated aarch64: every bit of the velocities is the same.
# Needs aarch64-linux-gnu-gcc and qemu-aarch64-static (Debian: gcc-aarch64-linux-gnu, libc6-dev-arm64-cross, qemu-user-static).
set -euo pipefail
cd "$(dirname "$0")/../../invariantqp/csrc"
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
sources=$(grep -L boundary.h ./*.c)
for compiler in "${CC:-cc}" aarch64-linux-gnu-gcc; do
    # shellcheck disable=SC2086
    "$compiler" -std=c11 -O2 -ffp-contract=off -Wall -Wextra -Werror -static -I. ../../tests/support/core_ticks.c $sources -lm -o "$folder/$compiler"
done
"$folder/${CC:-cc}" > "$folder/here"
qemu-aarch64-static "$folder/aarch64-linux-gnu-gcc" > "$folder/there"
cmp "$folder/here" "$folder/there"
tail -n 1 "$folder/here"

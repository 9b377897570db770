#!/usr/bin/env bash
# The install on a machine without a compiler: CMake, Ninja and Zig's compiler come from PyPI. It takes minutes: run it
# before a release.
set -euo pipefail
cd "$(dirname "$0")/../.."
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
python3 -m venv "$scratch/venv"
time PATH="$scratch/venv/bin" "$scratch/venv/bin/pip" install --quiet '.[robots]'
cd "$scratch"
venv/bin/python -c "import invariantqp._core, invariantqp as iq; assert iq.native"
venv/bin/invariantqp run so101_line

#!/usr/bin/env bash
# The tests of the engine with its sources built for the address and undefined-behaviour sanitizers and with bounds checks
# (gcc or clang).
set -euo pipefail
cd "$(dirname "$0")/../.."
kept=$(mktemp -d)
cp invariantqp/_*.so "$kept"
trap 'mv "$kept"/* invariantqp; rmdir "$kept"' EXIT
python invariantqp/core/backend.py --sanitize > "$kept.log" || { cat "$kept.log"; exit 1; }
# Both before Python, which is built without them: exceptions of C++ pass through the sanitizer.
runtime="$(${CC:-cc} -print-file-name=libasan.so) $(${CC:-cc} -print-file-name=libstdc++.so.6)"
# Python itself never frees some of what it allocates at its start, so leaks are not looked for.
ASAN_OPTIONS=detect_leaks=0 LD_PRELOAD="$runtime" \
    python -m pytest -q -n auto --capture=sys \
    tests/test_native.py::test_the_engine_is_part_of_the_package tests/velocity/test_compiled_law.py \
    tests/velocity/test_batch.py tests/velocity/test_several.py tests/control/test_frame_cost.py \
    tests/control/test_clearance_engine.py tests/control/test_clearance_start.py tests/geometry/test_distance.py \
    tests/control/test_loop.py tests/pose/test_search.py tests/pose/test_poses.py tests/robots/test_chain.py \
    tests/systems/test_projectors.py tests/systems/test_pseudoinverses.py::test_the_engine_inverts_well_conditioned_systems \
    tests/paths/test_joint_motion.py tests/paths/test_override.py tests/force/test_hybrid.py

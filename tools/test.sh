#!/usr/bin/env bash
# Builds one preset and runs every test: tools/test.sh [release|debug|asan-ubsan|tsan], release by default.
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-release}

tools/install.sh
cmake --preset "$preset"
cmake --build --preset "$preset"

# The drivers keep allocations and threads of their own until the process ends. Lavapipe holds more locks at once than the
# detector of deadlocks can count.
export LSAN_OPTIONS="suppressions=$PWD/tests/lsan.supp:print_suppressions=0"
export ASAN_OPTIONS="detect_leaks=1:strict_string_checks=1"
export UBSAN_OPTIONS="print_stacktrace=1"
export TSAN_OPTIONS="suppressions=$PWD/tests/tsan.supp:ignore_noninstrumented_modules=1:detect_deadlocks=0"
ctest --preset "$preset" --parallel "$(nproc)"

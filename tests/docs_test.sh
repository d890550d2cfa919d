#!/usr/bin/env bash
# Runs every command of documents as a reader would: all blocks marked sh, one after the other, in one empty folder; then, shortened,
# those that sentences speak of.
#   tests/docs_test.sh GNOMON BUILD DOCUMENT...
set -euo pipefail
source=$(realpath "$(dirname "$0")/..") build=$(realpath "$2")
documents=()
for document in "${@:3}"; do documents+=("$(realpath "$document")"); done
source "$source/tests/bake_scratch.sh"
trap 'kill $(jobs -p) 2>/dev/null || true; rm -rf "$work"' EXIT
# The sources as documents speak of them, whatever preset this is.
mkdir -p sources/build folder
for name in docs server tools; do ln -s "$source/$name" sources/; done
ln -s "$build" sources/build/release
export GNOMON=$work/sources PATH=$work/sources/build/release/tools:/usr/bin:$PATH
cd folder
for document in "${documents[@]}"; do
    blocks sh "$document" > "$work/commands"
    [[ -s $work/commands ]] || { : > log; fail "$document holds no command"; }
    # A document that fails leaves no server behind: its commands are a session of their own.
    setsid bash -euo pipefail "$work/commands" > log 2>&1 &
    commands=$!
    wait $commands || { kill -- -$commands 2>/dev/null || true; fail "$document"; }
    # Nothing that a document speaks of went wrong without a status.
    ! grep -E "^gnomon: |BROKEN" log || fail "$document"
done
# A workflow's script, in a checkout that has what it asks for.
for document in "${documents[@]}"; do blocks yaml "$document"; done > "$work/workflow"
sed -n '/run: |$/,/- uses/p' "$work/workflow" | sed '1d; $d' > "$work/commands"
[[ $(grep -c '\$gnomon ' "$work/commands") == 2 ]] || { cp "$work/workflow" log; fail "the workflow's script is not found"; }
mkdir "$work/sources/ci" && cp rules.txt "$work/sources/ci/" && cp hills.world "$work/sources/ci/town.world"
cp flight.tum "$work/sources/ci/drive.tum"
(cd "$work/sources" && build/release/tools/gnomon replay ci/town.world --path ci/drive.tum --results ci/accepted.sqlite &&
    bash -euo pipefail "$work/commands" && [[ -s report.html ]]) > log 2>&1 || fail "the workflow"
cp flight.tum hills.tum  # where gnomon-bench looks for a path
"$source/tests/docs_commands_test.py" "$source" > log 2>&1 || fail "a command in a sentence"
cat log
echo "commands of ${#documents[@]} documents: all run"

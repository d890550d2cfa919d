#!/usr/bin/env bash
# Runs every command of documents as a reader would: all blocks marked sh, one after the other, in one empty folder.
#   tests/docs_test.sh GNOMON DOCUMENT...
set -euo pipefail
documents=()
for document in "${@:2}"; do documents+=("$(realpath "$document")"); done
source "$(dirname "$0")/bake_scratch.sh"
mkdir bin && ln -s "$gnomon" bin/gnomon
PATH=$work/bin:$PATH
for document in "${documents[@]}"; do
    awk '/^```sh$/ { on = 1; next } /^```$/ { on = 0 } on' "$document" > commands
    [[ -s commands ]] || { : > log; fail "$document holds no command"; }
    bash -euo pipefail commands > log 2>&1 || fail "$document"
    # Nothing that a document speaks of went wrong without a status.
    ! grep -E "^gnomon: |BROKEN" log || fail "$document"
done
echo "commands of ${#documents[@]} documents: all run"

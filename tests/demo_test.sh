#!/usr/bin/env bash
# tools/demo.sh, with the program already built, the path cut to its first two seconds and maps small: it bakes, replays, verifies,
# and names a page that is there; a second run keeps the world, and results that another version wrote.
#   tests/demo_test.sh GNOMON
set -euo pipefail
tools=$(realpath "$(dirname "$0")/../tools")
source "$(dirname "$0")/bake_scratch.sh"
mkdir -p bin tools build/release/tools
cp "$tools/demo.sh" tools/
ln -s "$tools/install.sh" "$tools/packages.txt" tools/
ln -s "$(type -P true)" bin/cmake
cat > build/release/tools/gnomon <<END
#!/bin/sh
[ "\$1" != replay ] || set -- "\$@" --frames 0:60 --resolution 256
exec '$gnomon' "\$@"
END
chmod +x build/release/tools/gnomon
# demo NAME: runs it, and holds what it names against what is there.
demo() {
    PATH=$work/bin:$PATH tools/demo.sh > log 2>&1 || fail "$1"
    grep -q "^Verified .* texels compared, 0 differ" log || fail "$1 verified nothing"
    page=$(sed -n 's/^Open \([^ ]*\) in a browser.*/\1/p' log)
    [[ -s $page ]] || fail "$1 names no page that is there"
    while read -r made _; do [[ -s $made ]] || fail "$1: no $made"; done < <(grep '^out/[^ ]*  ' log)
}
demo "the first run"
baked=$(stat -c %Y.%i out/demo.world)
sqlite3 out/demo.results.sqlite 'PRAGMA user_version = 999'
demo "the second run"
[[ $(stat -c %Y.%i out/demo.world) == "$baked" ]] || fail "the world was baked again"
[[ $(sqlite3 out/demo.results.sqlite.old 'PRAGMA user_version') == 999 ]] || fail "results of another version were lost"
echo "the demo: runs, and runs again"

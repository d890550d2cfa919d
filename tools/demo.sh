#!/usr/bin/env bash
# Builds Gnomon, bakes the built-in world once and replays its path twice: every 25th frame is verified texel by
# texel; pictures, statistics and a report land in out/demo.
set -euo pipefail
cd "$(dirname "$0")/.."

tools/install.sh
cmake --preset release >/dev/null
cmake --build --preset release --target gnomon
gnomon=build/release/tools/gnomon

mkdir -p out
for file in out/demo.world out/demo.tum out/demo.movers.csv; do
    [ -f "$file" ] || {
        "$gnomon" bake procedural:7 -o out/demo.world
        break
    }
done
# Runs that another version wrote are kept, elsewhere.
kept=out/demo.results.sqlite
if [ -f $kept ] && ! "$gnomon" report $kept -o out/demo.old.html >/dev/null 2>&1; then mv --backup=numbered $kept $kept.old; fi
rm -f out/demo.old.html
play() { "$gnomon" replay out/demo.world --path out/demo.tum --movers out/demo.movers.csv --results "$1" --out out/demo "${@:2}"; }
# Once to find the frames that cost most, once to take their pictures and to verify.
rm -rf out/demo.first.sqlite
play out/demo.first.sqlite --verify=1000 >/dev/null
dearest=$("$gnomon" report out/demo.first.sqlite -o out/demo/report.html | sed -n 's/.*--dump-frames //p')
play out/demo.results.sqlite --verify=25 --dump out/demo/pictures --dump-frames "$dearest"
"$gnomon" report out/demo.results.sqlite -o out/demo/report.html >/dev/null
rm out/demo.first.sqlite

echo
echo "out/demo.world          the baked world, kept for the next run"
echo "out/demo/frames.csv     one row per frame and cascade (docs/columns.md)"
echo "out/demo/summary.json   the table above, for programs"
echo "out/demo.results.sqlite each run of this demo (docs/results.md)"
echo "out/demo/pictures       the 8 dearest frames: whole redraw, what the scroll kept, what was newly drawn; depth"
echo
echo "Open out/demo/report.html in a browser: where shadows cost what, and why (docs/reports.md)"

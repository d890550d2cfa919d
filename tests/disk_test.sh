#!/usr/bin/env bash
# Bakes onto disks that are full, read-only or used by another bake: one line says what and what to do, the old world
# stays, and what was baked is not lost.
#   tests/disk_test.sh GNOMON
# Status 77 where this user may not mount anything.
set -euo pipefail
if [[ -z ${GNOMON_MOUNTS:-} ]]; then
    unshare --user --map-root-user --mount true 2>/dev/null || exit 77
    GNOMON_MOUNTS=own exec unshare --user --map-root-user --mount "$0" "$@"
fi
source "$(dirname "$0")/bake_scratch.sh"
trap 'umount "$work/disk" 2>/dev/null || true; rm -rf "$work"' EXIT
bake() { "$gnomon" bake dem.asc -o "$1" >log 2>&1; }
# Ends with status 3 and one line of error that holds all the words.
refused() {
    local status=0 word
    bake "$1" || status=$?
    [[ $status == 3 ]] || fail "status $status instead of 3"
    [[ $(grep -c '^gnomon: ' log) == 1 ]] || fail "not one line of error"
    for word in "${@:2}"; do grep '^gnomon: ' log | grep -qF "$word" || fail "no word of '$word'"; done
}

small_dem 700 > dem.asc
"$gnomon" bake dem.asc -o old.world --bounds 0,0,1000,1000 >log 2>&1
bake whole.world || fail "the bake on a good disk"
whole=$(content whole.world) old=$(content old.world)
mkdir disk
mount -t tmpfs -o size=16m tmpfs disk
cp old.world disk/out.world

refused disk/out.world disk/out.world.baking "free some space there, or choose another disk" "goes on from where it was"
[[ $(content disk/out.world) == "$old" ]] || fail "the old world is gone"
mount -o remount,size=100m disk
bake disk/out.world || fail "the bake after there was room"
grep -q "goes on after" log || fail "what was baked is lost"
[[ $(content disk/out.world) == "$whole" ]] || fail "other content than on a good disk"
[[ $(echo disk/*) == disk/out.world ]] || fail "left behind: $(echo disk/*)"

mount -o remount,ro disk
refused disk/out.world disk/out.world.baking "Read-only file system" "must exist and be writable"
refused disk/new.world disk/new.world.baking "Read-only file system"
[[ $(content disk/out.world) == "$whole" ]] || fail "a world on a read-only disk does not open"

mount -o remount,rw disk
"$gnomon" bake dem.asc -o disk/out.world >first 2>&1 &
until [[ -s disk/out.world.baking ]] || ! kill -0 $!; do sleep 0.01; done
refused disk/out.world disk/out.world.baking "another bake is writing it" "wait for its end"
wait $! || fail "the first of two bakes"
[[ $(content disk/out.world) == "$whole" ]] || fail "two bakes at one file"

# Runs in a results file: those that are there stay, the one that does not fit is told and leaves nothing.
awk 'BEGIN { for (k = 0; k < 20; ++k) print k / 30, 500 + k, 100, -500, 0, 0, 0, 1 }' > way.tum
run() { "$gnomon" replay old.world --path way.tum --sun 135,40 --resolution 64 --results disk/r.sqlite --out run "$@" >log 2>&1; }
run || fail "the run on a good disk"
cp disk/r.sqlite before.sqlite
head -c 100000000 /dev/zero > disk/filler 2>/dev/null || true
status=0
run || status=$?
[[ $status == 3 ]] || fail "status $status instead of 3 on a full disk"
for word in disk/r.sqlite "free some space there, or choose another disk"; do
    grep '^gnomon: ' log | grep -qF "$word" || fail "no word of '$word'"
done
rm disk/filler
"$gnomon" report disk/r.sqlite --gate 'triangles.max >= 0' >log 2>&1 || fail "the run before the disk was full"
cmp -s disk/r.sqlite before.sqlite || fail "the results file has changed"
run || fail "the run after there was room"
"$gnomon" report --diff 'disk/r.sqlite#1' 'disk/r.sqlite#2' >log 2>&1 || fail "two runs"
grep -q "Nothing differs" log || fail "the runs differ"

# Shards of a sweep: what does not fit fails or is lost, and is resumed.
printf 'worlds = ["old.world"]\n[[path]]\nfile = "way.tum"\n[[settings]]\nsun = "135,40"\nresolution = 64\nguard-band = [1, 2]\n' > plan.toml
sweep() { "$gnomon" sweep "$@" >log 2>&1; }
fill() { head -c 100000000 /dev/zero > disk/filler 2>/dev/null || true; }
fill
status=0
sweep plan.toml -o disk/sweep || status=$?
[[ $status == 3 ]] || fail "status $status of a sweep on a full disk"
grep '^gnomon: ' log | grep -qF "with room" || fail "no word of room"
rm disk/filler
sweep plan.toml -o disk/sweep || fail "the sweep after there was room"
sweep merge disk/sweep -o swept.sqlite || fail "the merge"
rm disk/sweep/shards/*
fill
status=0
sweep resume disk/sweep || status=$?
[[ $status == 1 ]] || fail "status $status of shards on a full disk"
grep -q "2 shards: 0 done" log || fail "a shard that does not fit is done"
rm disk/filler
sweep resume disk/sweep || fail "the resumption after there was room"
sweep merge disk/sweep -o swept.sqlite || fail "other results after the disk was full"
grep -q "2 of 2 shards, 0 of them new" log || fail "shards merged twice"
[[ -z $(ls disk/sweep/shards | grep partial) ]] || fail "left behind: $(ls disk/sweep/shards)"
echo "full, read-only and shared disks: nothing lost"

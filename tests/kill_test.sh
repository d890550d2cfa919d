#!/usr/bin/env bash
# Kills a command at random moments, again and again, and gives it again each time: a reader never meets half a
# world, and the world that comes of it is the one that comes without a kill.
#   tests/kill_test.sh GNOMON [KILLS [SEED]]
# A victim is four functions, here those of `bake`: to kill another command, write its four and add it to `victims`.
set -euo pipefail
source "$(dirname "$0")/bake_scratch.sh"
kills=${2:-200}
seed=${3:-$(date +%s)}
victims=(bake)
microseconds() { echo "${EPOCHREALTIME/[.,]/}"; }

# Makes the input and what must come of it.
bake_prepare() {
    small_dem 700 > dem.asc
    "$gnomon" bake dem.asc -o old.world --bounds 0,0,1000,1000 >log 2>&1
    (bake_run) >log 2>&1
    old=$(content old.world) whole=$(content out.world)
    cp old.world out.world
}
# Becomes the command; the process is the one to kill.
bake_run() { exec "$gnomon" bake dem.asc -o out.world; }
# After a kill: the old world is there, or the new one is.
bake_killed() {
    local now
    now=$(content out.world)
    [[ $now == "$old" || $now == "$whole" ]] || fail "a world of content $now, neither old nor new"
    cp old.world out.world
}
# After a run to the end: all is done, and nothing else lies there.
bake_finished() {
    [[ $(content out.world) == "$whole" ]] || fail "other content than without a kill"
    [[ $(echo *) == "dem.asc log old.world out.world" ]] || fail "left behind: $(echo *)"
    cp old.world out.world
}

for victim in "${victims[@]}"; do
    RANDOM=$seed
    echo "$victim: $kills kills, seed $seed"
    start=$(microseconds)
    "${victim}_prepare"
    longest=$((($(microseconds) - start) / 2))
    killed=0 finished=0 wenton=0
    while ((killed < kills)); do
        delay=$(((RANDOM * 32768 + RANDOM) % longest))
        ("${victim}_run") >log 2>&1 &
        sleep "$((delay / 1000000)).$(printf %06d $((delay % 1000000)))"
        kill -9 $! 2>/dev/null || true
        status=0
        wait $! 2>/dev/null || status=$?
        if grep -q "goes on after" log; then wenton=$((wenton + 1)); fi
        case $status in
            137) killed=$((killed + 1)); "${victim}_killed" ;;
            0) finished=$((finished + 1)); "${victim}_finished" ;;
            *) fail "status $status" ;;
        esac
    done
    ("${victim}_run") >log 2>&1 || fail "the last run"
    "${victim}_finished"
    ((wenton > 0 || kills < 20)) || fail "no run went on with what a killed one had done"
    echo "$victim: killed $killed times, went on $wenton times, finished $((finished + 1)) times, all worlds equal"
done

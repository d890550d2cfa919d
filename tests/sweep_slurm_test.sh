#!/usr/bin/env bash
# A sweep on a real Slurm whose controller and one of two nodes are killed midway: all results arrive once, equal to those of one
# machine in every column that is not measured. Then the commands of docs/cluster.md that are for Slurm.
#   tests/sweep_slurm_test.sh GNOMON DOCUMENT
# Status 77 where Slurm cannot be started: it must be installed, and its daemons want to be root.
set -euo pipefail
skip() {
    echo "skipped: $*" >&2
    exit 77
}
if [[ -z ${GNOMON_PROCESSES:-} ]]; then
    for program in munged slurmctld slurmd sbatch; do
        [[ -n $(PATH=$PATH:/usr/sbin type -P $program) ]] || skip "there is no $program; tools/install.sh installs it"
    done
    [[ $(id -u) == 0 ]] || skip "Slurm's daemons want to be root"
    unshare --pid --fork --kill-child --mount-proc true 2>/dev/null || skip "this root may not make a namespace of processes"
    GNOMON_PROCESSES=own exec unshare --pid --fork --kill-child --mount-proc "$0" "$@"
fi
PATH=$PATH:/usr/sbin
document=$(realpath "$2") tests=$(dirname "$(realpath "$0")")
source "$tests/bake_scratch.sh"
source "$tests/slurm_scratch.sh"
: > log
# A count of `sweep status`; none where the line is not there.
count() { { "$gnomon" sweep status "$1" 2>>log || true; } | sed -n "1s/.*[ :]\([0-9]*\) $2.*/\1/p"; }
# wait_for SECONDS WHAT COMMAND: until the command holds.
wait_for() {
    local end=$((SECONDS + $1))
    until eval "$3"; do
        ((SECONDS < end)) || fail "after $1 s, $2; $(tail -n 20 slurmctld.log)"
        sleep 0.3
    done
}
# What whoever runs a cluster does: see to the nodes that Slurm has drained. A controller that was killed gives numbers of tasks
# again that nodes know ("Duplicate jobid"), and which nodes it drains for that depends on what was at work then.
undrain() {
    local node
    for node in $(sinfo --noheader --Node --states=drained --format=%N 2>>log); do
        echo "$node was drained: $(sinfo --noheader --Node --nodes="$node" --format=%E)"
        scontrol update nodename="$node" state=resume 2>>log || true  # it may have been given back since
    done
}
at_rest() { undrain && squeue >/dev/null 2>>log && [[ $(count "$1" running) == 0 && $(count "$1" queued) == 0 ]]; }

small_dem 60 > hills.asc
"$gnomon" bake hills.asc -o hills.world --chunk 160 --sun 135,40 >log 2>&1
awk 'BEGIN { for (k = 0; k < 60; ++k) printf "%.4f %.3f 60 -300 0 0 0 1\n", k / 30, 150 + k * 5 }' > flight.tum
cat > plan.toml <<'END'
worlds = ["hills.world"]
[[path]]
file = "flight.tum"
frames = "0:4"
[[path]]
file = "flight.tum"
frames = "20:24"
[[path]]
file = "flight.tum"
fps = 4
frames = "1:5"
[[settings]]
resolution = 64
guard-band = [1, 2, 4, 8]
occlusion = ["off", "exact"]
depth = [16, 32]
END
slurm_configure
munge_start && slurmctld -c && node_start n1 && node_start n2 || skip "Slurm does not start: $(tail -n 3 "$work"/*.log)"
wait_for 20 "the nodes are not there" '[[ $(sinfo --noheader --states=idle --format=%D 2>/dev/null) == 2 ]]'

"$gnomon" sweep plan.toml -o cluster --slurm >log 2>&1 || fail "the submission"
cancelled=$(cut -d ' ' -f 1 cluster/jobs)_47
scancel "$cancelled"  # a shard that Slurm will not run
wait_for 240 "a quarter of the shards is not done" '(( $(count cluster done) >= 12 ))'
wait_for 10 "a node has no task" '[[ -n $(tasks_of n1) && -n $(tasks_of n2) ]]'
# The controller, all of one node, and the tasks of the other, of which Slurm hears nothing but that they ended.
controller=$(cat slurmctld.pid)
kill -9 "$controller" $(processes_of n2) $(tasks_of n1) || true  # some may just have ended
done_then=$(count cluster done)
((done_then < 48)) || fail "all was done before anything was killed"
# Its port is not free before it is gone.
wait_for 20 "the controller does not die" '! grep -q "^State:.[^ZX]" "/proc/$controller/status" 2>/dev/null'
slurmctld && node_start n2 || fail "the daemons do not start again"
wait_for 30 "the controller does not start again" 'squeue >/dev/null 2>&1'
scancel "$cancelled" 2>>log || true  # a controller that was killed may have forgotten that
scontrol update nodename=n1 state=drain reason=planted  # at least one
sinfo -R | grep -q planted || fail "sinfo -R does not tell why a node is drained"
wait_for 240 "the cluster is not at rest" 'at_rest cluster'
resumed=0
until [[ $(count cluster done) == 48 ]]; do
    ((++resumed <= 3)) || fail "shards are lost again and again: $("$gnomon" sweep status cluster)"
    echo "$(count cluster lost) lost, $(count cluster failed) failed: resumed"
    "$gnomon" sweep resume cluster >log 2>&1 || fail "the resumption"
    wait_for 240 "the cluster is not at rest" 'at_rest cluster'
done
((resumed > 0)) || fail "a cancelled shard is there"

"$gnomon" sweep plan.toml -o alone >log 2>&1 || fail "the sweep on one machine"
"$gnomon" sweep merge cluster -o cluster.sqlite >log 2>&1 || fail "the merge of the cluster's results"
"$gnomon" sweep merge alone -o alone.sqlite >log 2>&1 || fail "the merge of one machine's results"
# By other means than gnomon's own.
cat > compare.py <<'END'
import sqlite3, sys
def rows(file):
    db = sqlite3.connect(file)
    found = {}
    shards = db.execute("SELECT key, run FROM shard").fetchall()
    assert len(shards) == len({run for key, run in shards}) == db.execute("SELECT count(*) FROM run").fetchone()[0] == 48, file
    for key, run in shards:
        for table in ("run", "frame", "cascade", "cause", "caster", "caster_sum", "read"):
            names = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
            kept = [n for n in names if not n.startswith("t_") and n not in
                    ("id", "run", "key", "device", "driver", "machine", "threads", "program", "summary")]
            own = "id" if table == "run" else "run"
            found[key, table] = [tuple(map(repr, row)) for row in
                                 db.execute(f"SELECT {', '.join(kept)} FROM {table} WHERE {own} = ? ORDER BY {', '.join(kept)}", (run,))]
    assert all(len(found[key, "frame"]) == 4 for key, run in shards)
    return found
a, b = rows(sys.argv[1]), rows(sys.argv[2])
assert a.keys() == b.keys(), "other shards"
differing = [key for key in a if a[key] != b[key]]
print(sum(map(len, a.values())), "rows,", len(differing), "tables differ")
sys.exit(bool(differing))
END
python3 compare.py cluster.sqlite alone.sqlite >log 2>&1 || fail "the results of the cluster and of one machine differ"
cat log
cp alone.sqlite planted.sqlite
python3 -c 'import sqlite3; db = sqlite3.connect("planted.sqlite"); db.execute("UPDATE cascade SET static_texels = static_texels + 1 WHERE run = 48 AND frame = (SELECT max(frame) FROM frame WHERE run = 48) AND cascade = 0"); db.commit()'
! python3 compare.py planted.sqlite alone.sqlite >log 2>&1 || fail "a planted difference was not found"
"$gnomon" sweep merge cluster -o alone.sqlite >log 2>&1 || fail "gnomon's own comparison"
grep -q "48 of 48 shards, 0 of them new" log || fail "a shard was merged twice"
# Nothing is left of what was killed.
! ls cluster/shards | grep -q partial || "$gnomon" sweep resume cluster --here >log 2>&1
[[ $(ls cluster/shards/*.sqlite | wc -l) -ge 48 && -z $(ls cluster/shards | grep partial) ]] || fail "left behind: $(ls cluster/shards)"

# The document's commands, in this folder: those for one machine first, since they make the plan.
mkdir bin && ln -s "$gnomon" bin/gnomon
PATH=$work/bin:$PATH
rm plan.toml
blocks "sh( slurm)?" "$document" > commands
grep -q -- --slurm commands || fail "$document has no command for Slurm"
timeout 240 bash -euo pipefail commands >log 2>&1 || fail "the commands of $document"
echo "48 shards, $done_then done before the controller and a node were killed, resumed $resumed times: each once, and as on one machine"

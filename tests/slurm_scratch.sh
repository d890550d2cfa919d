# tests/slurm_scratch.sh — to be sourced after bake_scratch.sh: a Slurm of one controller and two nodes on this machine, all of it
# in the scratch folder. The script is process 1 of a namespace of its own, so that nothing of it outlives the script.

export SLURM_CONF=$work/slurm.conf
port=$((20000 + RANDOM % 10000))  # below those that the system hands out
host=$(hostname -s)

# What is Slurm's or a task's ends before its folder goes.
trap 'kill -9 -1 2>/dev/null; rm -rf "$work"' EXIT

slurm_configure() {
    chmod 755 "$work"
    mkdir "$work/state" "$work/spool-n1" "$work/spool-n2"
    (umask 077 && head -c 1024 /dev/urandom > "$work/munge.key")
    # Times are short: a node is given up after 5 s, and a task of it may start anew as soon as its old credential is void.
    cat > "$SLURM_CONF" <<END
ClusterName=gnomon
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
AuthInfo=socket=$work/munge.socket,cred_expire=5
SlurmUser=root
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool-%n
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd-%n.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
SlurmdTimeout=5
MessageTimeout=5
KillWait=1
SchedulerParameters=sched_interval=1,bf_interval=1,batch_sched_delay=0
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 1)) CPUs=2
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 2)) CPUs=2
PartitionName=all Nodes=n1,n2 Default=YES State=UP
END
}
munge_start() {
    munged --force --key-file="$work/munge.key" --socket="$work/munge.socket" --pid-file="$work/munged.pid" \
        --log-file="$work/munged.log" --seed-file="$work/munge.seed"
}
node_start() { slurmd -N "$1"; }
# Programs under gnomon's name that Slurm started for a node, whose name they have in their environment.
tasks_of() {
    local p
    for p in $(grep -lzx "SLURMD_NODENAME=$1" /proc/[0-9]*/environ 2>/dev/null | cut -d/ -f3); do
        [[ $(readlink "/proc/$p/exe") != "$gnomon" ]] || echo "$p"
    done
}
# All that would go with a node: its daemon, its tasks, and who watches them.
processes_of() {
    local p
    cat "$work/slurmd-$1.pid"
    for p in $(tasks_of "$1"); do echo "$p" "$(awk '{ print $4 }' "/proc/$p/stat" 2>/dev/null)"; done
}

#!/usr/bin/env bash
# A private Slurm on one machine, for tests: slurm.sh up|down|status|env|kill-node N|start-node N|kill-controller|start-controller (folder: $SWM_SLURM_ROOT)
# Debian/Ubuntu packages only, no systemd, no cgroups, nothing under /etc is written. Repeatable: `up` twice leaves one cluster.
# Exit status: 0 up; 77 not possible here, with the reason on stderr (a test says "skipped: REASON").
set -u
cmd=${1:-up}; arg=${2:-}
root=${SWM_SLURM_ROOT:-/tmp/swm-slurm}
nodes=${SWM_SLURM_NODES:-3}
port=${SWM_SLURM_PORT:-17100}            # slurmctld: port; slurmd i: port+i
lib=/usr/lib/$(uname -m)-linux-gnu/slurm-wlm
skip() { echo "skip: $*" >&2; exit 77; }
fail() { echo "error: $*" >&2; exit 1; }
export SLURM_CONF=$root/slurm.conf
# A zombie answers kill -0, and in a container nobody may collect it: the state counts.
alive() { local s; s=$(sed 's/.*) //; s/ .*//' "/proc/$1/stat" 2>/dev/null) && [ -n "$s" ] && [ "$s" != Z ]; }
pidof_file() { [ -s "$1" ] && alive "$(cat "$1")" && cat "$1"; }
# Started in a session of its own, so that a signal to the test's group does not reach it; output closed, or a caller's pipe never ends.
start() { setsid -f "$@" </dev/null >>"$root/log/start.log" 2>&1; }

install() {
  command -v slurmctld >/dev/null && command -v slurmd >/dev/null && command -v munged >/dev/null && return
  [ -n "${SWM_SLURM_INSTALL:-}" ] || skip "slurm is not installed; SWM_SLURM_INSTALL=1 lets this script install it by apt-get, as root"
  [ "$(id -u)" = 0 ] || skip "slurm is not installed, and only root can install it"
  command -v apt-get >/dev/null || skip "no apt-get here"
  local log=$root/log/apt.log
  { apt-get update -q; DEBIAN_FRONTEND=noninteractive apt-get install -yq --no-install-recommends slurmctld slurmd slurm-client munge; } >"$log" 2>&1 \
    || skip "apt-get cannot install slurm: $(tail -1 "$log")"
}

configure() {
  local i host; host=$(hostname -s)
  mkdir -p "$root"/{ctld,spool,log,munge}; chmod 755 "$root" "$root/munge"
  [ -s "$root/munge/key" ] || head -c 1024 /dev/urandom >"$root/munge/key"
  chmod 600 "$root/munge/key"
  cat >"$root/slurm.conf" <<CONF
ClusterName=swmtest
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
# A requeued job waits cred_expire + 1 seconds before it may start: 121 by default. 5 is the least; less is ignored without a word.
AuthInfo=socket=$root/munge/socket,cred_expire=5
CryptoType=crypto/munge
StateSaveLocation=$root/ctld
SlurmdSpoolDir=$root/spool/%n
SlurmctldPidFile=$root/slurmctld.pid
SlurmdPidFile=$root/slurmd.%n.pid
SlurmctldLogFile=$root/log/slurmctld.log
SlurmdLogFile=$root/log/slurmd.%n.log
PluginDir=$lib
# No cgroups, no root helpers: what a container allows.
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=1,sched_min_interval=0,bf_interval=1,batch_sched_delay=0
ReturnToService=2
SlurmdTimeout=5
SlurmctldTimeout=10
InactiveLimit=0
KillWait=5
MinJobAge=3600
MaxArraySize=1001
MaxJobCount=20000
JobRequeue=1
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/filetxt
JobCompLoc=$root/log/jobcomp.txt
PropagateResourceLimits=NONE
CONF
  for i in $(seq "$nodes"); do
    mkdir -p "$root/spool/n$i"
    echo "NodeName=n$i NodeAddr=127.0.0.1 NodeHostname=$host Port=$((port + i)) CPUs=2 CoresPerSocket=2 RealMemory=1000 State=UNKNOWN" >>"$root/slurm.conf"
  done
  cat >>"$root/slurm.conf" <<CONF
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
PartitionName=cpu Nodes=n[1-$nodes] Default=YES MaxTime=60 DefaultTime=10 PriorityTier=10 PreemptMode=OFF
PartitionName=spot Nodes=n[1-$nodes] MaxTime=60 DefaultTime=10 PriorityTier=1 PreemptMode=REQUEUE GraceTime=5
CONF
}

node() { pidof_file "$root/slurmd.n$1.pid" >/dev/null || start slurmd -N "n$1"; }

up() {
  mkdir -p "$root/log" || skip "cannot make $root"
  install
  configure
  pidof_file "$root/munge/munged.pid" >/dev/null || start munged --force --key-file="$root/munge/key" --socket="$root/munge/socket" \
    --pid-file="$root/munge/munged.pid" --log-file="$root/munge/munged.log" --seed-file="$root/munge/seed" --num-threads=2
  local i
  for i in $(seq 50); do munge -n -S "$root/munge/socket" >/dev/null 2>&1 && break; sleep 0.1; done
  munge -n -S "$root/munge/socket" >/dev/null || skip "munged does not answer: $(tail -2 "$root/munge/munged.log")"
  pidof_file "$root/slurmctld.pid" >/dev/null || start slurmctld
  for i in $(seq "$nodes"); do node "$i"; done
  for i in $(seq 300); do
    [ "$(sinfo -h -N -t idle,alloc,mix -o %N 2>/dev/null | sort -u | wc -l)" -ge "$nodes" ] && return
    sleep 0.1
  done
  skip "the nodes did not come up: $(sinfo -N -h 2>&1 | tr '\n' ';') $(tail -3 "$root/log/slurmctld.log")"
}

stop() { # by pid only
  local pid; pid=$(pidof_file "$1") || return 0
  kill "$pid"; for _ in $(seq 50); do alive "$pid" || return 0; sleep 0.1; done; kill -9 "$pid" 2>/dev/null
}

# The processes below one, itself first.
below() { local p; echo "$1"; for p in $(pgrep -P "$1"); do below "$p"; done; }

kill_node() { # With what runs on it, which else would report its own end.
  local steps pids=() id pid
  for id in $(squeue -h -r -t RUNNING -w "n$arg" -o %A); do
    for pid in $(pgrep -f "^slurmstepd: \[$id\."); do steps=$(below "$pid"); pids+=($steps); done
  done
  # The watchers come before the watched; one may have ended by now.
  pid=$(cat "$root/slurmd.n$arg.pid"); kill -9 "$pid" "${pids[@]}" 2>/dev/null
  sleep 0.2; alive "$pid" && fail "node n$arg still runs"
  return 0
}

case $cmd in
  up) up; echo "export SLURM_CONF=$root/slurm.conf" ;;
  env) echo "export SLURM_CONF=$root/slurm.conf" ;;
  status) sinfo; squeue ;;
  kill-node) kill_node ;;
  kill-controller) kill -9 "$(cat "$root/slurmctld.pid")" ;;
  start-controller) pidof_file "$root/slurmctld.pid" >/dev/null || start slurmctld ;;
  start-node) node "$arg" ;;
  down)
    command -v scancel >/dev/null && pidof_file "$root/slurmctld.pid" >/dev/null && timeout 10 scancel -u "$(id -un)" 2>/dev/null
    for f in "$root"/slurmd.*.pid "$root/slurmctld.pid" "$root/munge/munged.pid"; do stop "$f"; done ;;
  *) fail "usage: $0 up|down|status|env|kill-node N|start-node N|kill-controller|start-controller" ;;
esac

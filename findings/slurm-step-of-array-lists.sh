#!/usr/bin/env bash
# Software:  Slurm 22.05 (Debian 12), in a cluster of its own on this machine that `tests/cluster/slurm.sh` starts and stops.
# Expected:  for `--array=2,4`, SLURM_ARRAY_TASK_STEP is 2, or is not set.
# Happens:   it is 1: who computes the number of tasks as (MAX - MIN) / STEP + 1 gets 3 for two tasks. SLURM_ARRAY_TASK_COUNT is right.
# Who:       users who divide episodes by array index, and run tasks again that failed: `--array=2,4` after `--array=0-7`.
# Seen:      min 2, max 4, step 1, count 2
set -euo pipefail
folder=$(mktemp -d)
export SWM_SLURM_ROOT=$folder/slurm SWM_SLURM_PORT=${SWM_SLURM_PORT:-17900} SWM_SLURM_NODES=1
cluster="$(dirname "${BASH_SOURCE[0]}")/../tests/cluster/slurm.sh"
trap '"$cluster" down >/dev/null 2>&1; rm -rf "$folder"' EXIT
SWM_SLURM_INSTALL=1 "$cluster" up >/dev/null
export SLURM_CONF=$SWM_SLURM_ROOT/slurm.conf
cat >"$folder/task" <<'TASK'
#!/bin/bash
echo "min $SLURM_ARRAY_TASK_MIN, max $SLURM_ARRAY_TASK_MAX, step $SLURM_ARRAY_TASK_STEP, count $SLURM_ARRAY_TASK_COUNT"
TASK
sbatch --quiet --wait --array=2,4 --output="$folder/out.%a" "$folder/task"
echo "$(sinfo --version): $(cat "$folder/out.2")"
grep -qx "min 2, max 4, step 1, count 2" "$folder/out.2"

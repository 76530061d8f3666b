#!/usr/bin/env bash
# gc-idm beside CEM on the same world model: idm.sh [PROGRAM] [FOLDER]   (default: swm on the PATH, idm-results)
#
# PROGRAM needs the feature baselines. For TwoRoom and PushT's `weak` it records episodes, trains one LeWM for each task and `gc-idm` over it, three
# seeds of each, and evaluates on the same 100 pairs: `gc-idm`, the search that it begins (`proposal`), and CEM with 300 candidates and 30
# iterations. Printed are success with 95 % intervals, and plans per second of CPU time: decisions of `gc-idm`, plans of a search, both with
# the encoding of the images that they see. What is there already is not done again.
#
# STEPS, IDM_STEPS, PAIRS, SEEDS and TASKS change the sizes: STEPS=50 PAIRS=4 SEEDS=1 TASKS=tworoom shows that all of it runs.
set -euo pipefail
swm=$(realpath "${1:-$(command -v swm)}")
out=${2:-idm-results}
steps=${STEPS:-500} idm_steps=${IDM_STEPS:-3000} pairs=${PAIRS:-100} seeds=${SEEDS:-3}
mkdir -p "$out"
cd "$out"

once() { [ -e "$1" ] || "$swm" --quiet "${@:2}"; }
# Seconds of CPU time, of one thread, of an evaluation that is not there yet; the file `seconds` keeps them.
evaluate() {
  local place=$1 manifest=$2 policy=$3
  if [ ! -e "$place/seconds" ]; then
    rm -rf "$place"
    TIMEFORMAT='%U %S'
    { time "$swm" --quiet eval --manifest "$manifest" --policy "$policy" --reference none --threads 1 --out "$place" > "$place.log"; } 2> "$place.time"
    tail -n 1 "$place.time" | awk '{ print $1 + $2 }' > "$place/seconds"
  fi
}

record_tworoom() {
  once tworoom.h5 collect swm/TwoRoom-v2 --policy noisy-expert:2 --episodes "${EPISODES:-2000}" --seed 1 --image-size 64x64 \
    --env-option render=fast --without goal --out tworoom.h5
  once tworoom.toml manifest make swm/TwoRoom-v2 --dataset tworoom.h5 --tier historic --episodes "$pairs" --goal-offset 25 --budget 50 \
    --image-size 64x64 --env-option render=fast --out tworoom.toml
}
record_pusht() {
  once pusht.h5 collect swm/PushT-v1 --policy weak --episodes "${EPISODES:-3000}" --max-steps 100 --seed 101 --image-size 64x64 \
    --env-option render=fast --without goal --out pusht.h5
  once pusht-pairs.h5 collect swm/PushT-v1 --policy weak --episodes 200 --max-steps 100 --seed 103 --image-size 64x64 \
    --env-option render=fast --without goal --out pusht-pairs.h5
  once pusht.toml manifest make swm/PushT-v1 --dataset pusht-pairs.h5 --tier historic --episodes "$pairs" --goal-offset 25 --budget 50 \
    --image-size 64x64 --env-option render=fast --out pusht.toml
}

for task in ${TASKS:-tworoom pusht}; do
  "record_$task"
  for ((seed = 1; seed <= seeds; seed++)); do
    once "$task-lewm-$seed" train lewm --dataset "$task.h5" --preset small --steps "$steps" --seed "$seed" --out "$task-lewm-$seed"
    once "$task-idm-$seed" train gc-idm --dataset "$task.h5" --encoder "$task-lewm-$seed" --steps "$idm_steps" --seed "$seed" --out "$task-idm-$seed"
    search="mpc:$task-lewm-$seed,samples=300,iterations=30,elites=30"
    evaluate "$task-acts-$seed" "$task.toml" "gc-idm:$task-idm-$seed"
    evaluate "$task-begins-$seed" "$task.toml" "mpc:$task-lewm-$seed,proposal=$task-idm-$seed,samples=300,iterations=3,elites=30,sigma=0.3"
    evaluate "$task-cem-$seed" "$task.toml" "$search"
  done
done

# A decision of gc-idm is a block of actions, a plan of a search 5 blocks; both see new images each time.
python3 - "$seeds" ${TASKS:-tworoom pusht} << 'END'
import json, math, sys

seeds, tasks = int(sys.argv[1]), sys.argv[2:]
print(f"{'policy':<28}{'success in percent (95 %)':<30}{'by seed':<20}{'plans per CPU second':>22}")
for task in tasks:
    rates = {}
    for name, what, block in (("acts", "gc-idm", 5), ("begins", "gc-idm, then 3 of CEM", 25), ("cem", "CEM 300 x 30", 25)):
        done, each, plans, seconds = [], [], 0, 0.0
        for seed in range(1, seeds + 1):
            place = f"{task}-{name}-{seed}"
            episodes = json.load(open(f"{place}/receipt.json"))["episodes"]
            done += [episode["success"] for episode in episodes]
            each.append(100 * sum(episode["success"] for episode in episodes) / len(episodes))
            plans += sum(math.ceil(episode["steps"] / block) for episode in episodes)
            seconds += float(open(f"{place}/seconds").read())
        n, k, z = len(done), sum(done), 1.959964
        middle, half = (k + z * z / 2) / (n + z * z), z * math.sqrt(k * (n - k) / n + z * z / 4) / (n + z * z)
        rates[name] = plans / seconds
        interval = f"{100 * k / n:.1f} ({100 * (middle - half):.1f} to {100 * (middle + half):.1f})"
        print(f"{task + ': ' + what:<28}{interval:<30}{', '.join(f'{rate:.0f}' for rate in each):<20}{rates[name]:>22.2f}")
    print(f"{task}: gc-idm makes {rates['acts'] / rates['cem']:.1f} times the plans of CEM per CPU second")
END

#!/usr/bin/env bash
# Models that do not break under changed looks, measured: run.sh PROGRAM [OUT]   (default: robust-out)
#
# Records PushT without images, trains for each seed a canonicalizer, an encoder that draws and a world model, and evaluates them in
# the usual look, under each visual factor and under all of them, on pairs that nothing learns from. Every stage has a time limit, and
# a stage that is done is not repeated: the same command continues. Results lie in OUT/results: robustness.md, .json and .svg, the
# sweeps, the runs with their last weights, and stages.tsv with the seconds of each stage.
#
# The defaults fill about nine minutes on 16 cores. MINI=1 runs all of it in about a minute on two.
#
#   SEEDS="1 2 3"      trainings
#   TIER=slow|weak     whose episodes: a noisy expert's with small actions, or random pushes'
#   CORES=16           cores that there are
#   EVALUATE=s         seconds kept for the evaluation; the rest of BUDGET (seconds, 535) is training's
set -uo pipefail
swm=$(realpath "${1:?name the program swm}"); out=${2:-robust-out}
mkdir -p "$out"; out=$(realpath "$out"); cd "$out" || exit 1
: "${SEEDS:=1 2 3}" "${TIER:=slow}" "${CORES:=$(nproc)}" "${BUDGET:=535}" "${EVALUATE:=220}" "${MINI:=0}"
: "${EPISODES:=1200}" "${DRAW_STEPS:=5000}" "${ENCODER_STEPS:=1500}" "${MODEL_STEPS:=3000}" "${PAIRS:=100}"
: "${SEARCH:=samples=64,iterations=5,elites=8,sigma=1,sigma_min=0.1,clip=true,return_best=true}"
: "${FACTORS:=background.color,agent.color,block.color,goal.color,goal.angle,goal.position,goal.scale}"
if [ "$MINI" = 1 ]; then
  SEEDS="1 2"; EPISODES=30; DRAW_STEPS=30; ENCODER_STEPS=30; MODEL_STEPS=40; PAIRS=4; BUDGET=240; EVALUATE=120
  SEARCH="samples=8,iterations=2,elites=2,clip=true,return_best=true"; FACTORS=background.color,goal.angle
fi
read -ra seeds <<< "$SEEDS"
each=$((CORES / ${#seeds[@]})); [ "$each" -ge 1 ] || each=1
# What draws takes most of the time; encoder and model share the rest.
drawing=$(((each * 3 + 2) / 5)); [ "$drawing" -ge 1 ] || drawing=1
others=$((each - drawing)); [ "$others" -ge 1 ] || others=1
begun=$(date +%s)
elapsed() { echo $(($(date +%s) - begun)); }
left() { local seconds=$((BUDGET - EVALUATE - $(elapsed))); echo $((seconds > 20 ? seconds : 20)); }
mkdir -p results logs done

# stage NAME SECONDS COMMAND…: runs it once; after the time limit it is asked to stop, and what it has written stays.
stage() {
  local name=$1 limit=$2 status from; shift 2
  [ -e "done/$name" ] && return 0
  from=$(date +%s.%N)
  timeout -s TERM -k 20 "$limit" "$@" > "logs/$name.log" 2>&1; status=$?
  printf '%s\t%s\t%.1f\t%s\n' "$name" "$status" "$(echo "$(date +%s.%N) $from" | awk '{print $1 - $2}')" "$*" >> results/stages.tsv
  [ $status = 0 ] && touch "done/$name"
  echo "$(elapsed) s: $name: $status" >&2
  return $status
}

case $TIER in
  slow) policy=noisy-expert:0.15,max_step=8,replan=15,samples=40,refinements=1,beams=2,detours=2,beam_samples=10; length=300 ;;
  weak) policy=weak; length=100 ;;
  *) echo "TIER=$TIER: use slow or weak" >&2; exit 2 ;;
esac
collect=(collect swm/PushT-v1 --policy "$policy" --max-steps "$length" --env-option render=fast --threads "$CORES" --num-envs "$((2 * CORES))" --mode overwrite)
stage record "$BUDGET" "$swm" "${collect[@]}" --replayable --without goal --episodes "$EPISODES" --seed 101 --out data.h5 || exit 1
stage pairs "$BUDGET" "$swm" "${collect[@]}" --image-size 64x64 --without goal --episodes "$((2 * PAIRS))" --seed 103 --out pairs.h5 || exit 1
stage manifest 30 "$swm" manifest make swm/PushT-v1 --dataset pairs.h5 --tier historic --episodes "$PAIRS" --goal-offset 25 --budget 50 \
  --image-size 64x64 --env-option render=fast --out historic.toml || exit 1

# A schematic look, in which drawing alone finds what moves: a black table without a mark, a bright agent, a dim block.
schematic=(background.color=black goal.color=black agent.color=255,0,0 block.color=0,0,85)
looks() { local option=$1 value; for value in "${schematic[@]}"; do printf '%s\n%s\n' "$option" "$value"; done; }
mapfile -t canonical < <(looks --canonical)
mapfile -t look < <(looks --look)

# train NAME RUN THREADS BASELINE OPTION…: a training, or its continuation. After the time limit, its last checkpoint is what is used.
train() {
  local name=$1 run=$2 threads=$3 status; shift 3
  if [ -e "$run/config.json" ]; then
    stage "$name" "$(left)" "$swm" train --resume "$run" --threads "$threads"
  else
    stage "$name" "$(left)" "$swm" train "$@" --dataset data.h5 --threads "$threads" --checkpoint-every 2500 --log-every 100 --out "$run"
  fi
  status=$?
  if [ $status = 124 ] && ls "$run"/checkpoints/*.safetensors > /dev/null 2>&1; then touch "done/$name"; return 0; fi
  return $status
}
draw() { # SEED
  train "canonical-$1" "runs/canonical-$1" "$drawing" canonical --seed "$1" --steps "$DRAW_STEPS" --vary visual --vary-share 0.6 \
    --vary-usual 0.1 "${canonical[@]}"
}
model() { # SEED
  train "model-$1" "runs/model-$1" "$others" keypoint-wm --seed "$1" --steps "$MODEL_STEPS" --encoder-steps "$ENCODER_STEPS" "${look[@]}"
}
for seed in "${seeds[@]}"; do draw "$seed" & model "$seed" & done
wait

# One sweep a seed, at once; then one table of those that are done. What has no time left is continued by the same command.
joint=${FACTORS//,/+}; factors=$FACTORS,agent.color+background.color+block.color+goal.color,$joint
policy_of() { echo "mpc:$out/runs/model-$1,canonical=$out/runs/canonical-$1,$SEARCH"; }
sweep() { # SEED
  local limit=$((BUDGET - $(elapsed) - 5)); [ "$limit" -gt 30 ] || limit=30
  stage "sweep-$1" "$limit" "$swm" sweep --manifest historic.toml --policy "$(policy_of "$1")" --factors "$factors" \
    --threads "$each" --out "sweeps/$1"
}
for seed in "${seeds[@]}"; do sweep "$seed" & done
wait
policies=(); number=0; mkdir -p results/sweeps
for seed in "${seeds[@]}"; do
  [ -e "sweeps/$seed/sweep.json" ] || continue
  number=$((number + 1)); policies+=(--policy "$(policy_of "$seed")")
  rm -rf "results/sweeps/$number"; cp -r "sweeps/$seed" "results/sweeps/$number"
done
if [ "$number" -gt 0 ]; then
  rm -f done/table
  stage table 30 "$swm" robustness pusht --manifest historic.toml "${policies[@]}" --factors "$factors" --threads "$CORES" --out results
fi

# What it takes to repeat and to use it.
cp historic.toml results/
for run in runs/*; do
  ls "$run"/checkpoints/*.safetensors > /dev/null 2>&1 || continue
  to=results/$run; mkdir -p "$to/checkpoints"
  cp "$run/config.json" "$run/metrics.jsonl" "$to/" 2> /dev/null
  last=$(ls "$run/checkpoints" | grep -v training | sed -n 's/^\(step-.*\)\.safetensors$/\1/p' | sort | tail -1)
  cp "$run/checkpoints/$last".{json,safetensors} "$to/checkpoints/"
done
{ "$swm" --version; nproc; uname -srm; sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1; elapsed; } > results/machine.txt
[ -e results/robustness.md ] && cat results/robustness.md
[ -e done/table ]

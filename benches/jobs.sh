#!/usr/bin/env bash
# Jobs at the size of a cluster, simulated on one machine: jobs.sh [PROGRAM]   (default: swm on the PATH)
#
# A job of a million episodes in 1,000 shards and one of a sweep are submitted to stand-ins for Slurm's programs. Printed are the
# seconds of `swm submit` and `swm jobs`, and, where strace is there, the operations on files that a shard costs the file system:
# files and folders made, renamed and removed.
set -euo pipefail
swm=$(realpath "${1:-$(command -v swm)}")
root=$(mktemp -d); trap 'rm -rf "$root"' EXIT
cd "$root"
mkdir bin
stand_in() { printf '#!/bin/sh\n%s\n' "$2" > "bin/$1"; chmod +x "bin/$1"; }
stand_in sbatch 'cat > /dev/null; echo 7'
stand_in squeue 'exit 0'
stand_in scontrol 'echo "MaxArraySize = 1001"'
export PATH=$root/bin:$PATH
TIMEFORMAT=%R
# The seconds of a command; one that fails is shown.
seconds() {
  local name=$1 took; shift
  took=$({ time "$@" > out 2>&1; } 2>&1) || { cat out; exit 1; }
  printf '%-58s %s s\n' "$name" "$took"
}

collect=(collect swm/TwoRoom-v2 --policy expert --image-size none --max-steps 30 --seed 1)
seconds "submit: 64 shards" "$swm" submit --no-copy --on slurm --shards 64 --job small -- "${collect[@]}" --episodes 1000000
seconds "submit: 64 shards, with the program" "$swm" submit --on slurm --shards 64 --job copy -- "${collect[@]}" --episodes 1000000
seconds "submit: 1,000 shards of a million episodes" "$swm" submit --no-copy --on slurm --shards 1000 --job large -- "${collect[@]}" --episodes 1000000
for i in $(seq 990); do
  printf '{"shard":%d,"range":[0,1000],"episodes":1000,"bytes":1,"sha256":"","attempt":1,"node":"n","seconds":9.5}' "$i" > "$(printf 'large/done/%04d.json' "$i")"
  printf 'episode %d written to x (30 rows)\n' "$((i * 1000))" > "$(printf 'large/logs/%04d.log' "$i")"
done
seconds "jobs: 1,000 shards, 990 done" "$swm" jobs large
seconds "submit again: 10 are missing" "$swm" submit --job large

"$swm" collect swm/TwoRoom-v2 --policy expert --image-size none --episodes 30 --seed 2 --out rooms.h5 --quiet > /dev/null
"$swm" manifest make swm/TwoRoom-v2 --tier moderate --dataset rooms.h5 --held-out 1 --episodes 5 --budget 20 --out m.toml --quiet > /dev/null
sweep=(sweep --manifest m.toml --policy expert --values grid --points 600)
seconds "submit: 1,000 shards of a sweep, 600 values of each factor" "$swm" submit --no-copy --on slurm --shards 1000 --job sweep -- "${sweep[@]}"
grep -o '"episodes": [0-9]*' sweep/job.json | sed 's/.* /  its episodes (5 per cell): /'

if command -v strace > /dev/null; then
  "$swm" submit --no-copy --on script --shards 4 --job traced -- "${collect[@]}" --episodes 8 > /dev/null
  traced=$(strace -f -e trace=open,openat,mkdir,rename,renameat,renameat2,unlink,unlinkat -o trace "$swm" task traced --index 2 2>&1) || echo "$traced"
  # Opening a file again makes none.
  count() { grep -E "$1" trace | grep -vE 'ENOENT|EEXIST' | grep -o "$root/traced/[^\"]*" | sort -u | wc -l; }
  renamed=$(count rename)
  printf '%-58s made %s, renamed %s, removed %s\n' "operations of a shard on the job's folder" \
    "$(count 'O_CREAT|mkdir')" "$((renamed / 2))" "$(count unlink)"
fi

#!/usr/bin/env bash
# Software:  datasets 5.2.0 (Hugging Face): the cache of `map`, of a dataset on disk.
# Expected:  a function that was edited runs again: the fingerprint has the hash of the transform.
# Happens:   a function of an imported module is hashed by its name, and so is one that a lambda calls: after an edit, a new process
#            gets the values of the old code. A function of the script itself is hashed by its code.
# Who:       users who compute latents, rewards or goals by functions of their package, and fix one of them.
# Seen:      after the factor 10 was edited to 1000: named [10.0, 20.0], lambda [10.0, 20.0], without cache [1000.0, 2000.0]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages datasets==5.2.0
cat >"$folder/run.py" <<'PYTHON'
import sys
from pathlib import Path

import datasets

import rewards

datasets.disable_progress_bars()
path, expected = Path("data"), eval(sys.argv[1])
if not path.exists():
    datasets.Dataset.from_dict({"reward": [1.0, 2.0]}).save_to_disk(path)
data = datasets.load_from_disk(path)
found = {
    "named": data.map(rewards.scaled)["reward"][:],
    "lambda": data.map(lambda row: rewards.scaled(row))["reward"][:],
    "without cache": data.map(rewards.scaled, load_from_cache_file=False)["reward"][:],
}
print(f"datasets {datasets.__version__}: {found}")
assert list(found.values()) == expected, "changed"
PYTHON
cd "$folder"
export HF_HOME=$folder/cache HF_HUB_OFFLINE=1 PYTHONDONTWRITEBYTECODE=1
for factor in 10 1000; do
    printf 'def scaled(row):\n    return {"reward": row["reward"] * %s}\n' "$factor" >rewards.py
    "$python" run.py "[[10.0, 20.0], [10.0, 20.0], [$factor.0, 2 * $factor.0]]"
done

#!/usr/bin/env bash
# Software:  gymnasium 1.4.0: `reset(seed=s)` of vector environments.
# Expected:  runs of seeds 0, 1, 2 are independent repetitions.
# Happens:   environment i gets seed s + i, so that of 4 environments 3 begin the same episodes under seeds 0 and 1: a mean over
#            neighboring seeds counts most of them several times, and its interval is too narrow.
# Who:       users who compare a table of seeds from Gymnasium with one from here, where runs of other seeds share no episode.
# Seen:      3 of 4 first observations of seed 1 are among those of seed 0
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages gymnasium==1.4.0 numpy==2.4.6
"$python" - <<'PYTHON'
import gymnasium as gym

def first(seed):
    return gym.make_vec("CartPole-v1", num_envs=4, vectorization_mode="sync").reset(seed=seed)[0]

shared = (first(0)[1:] == first(1)[:-1]).all(axis=1)
print(f"gymnasium {gym.__version__}: {shared.sum()} of 4 first observations of seed 1 are among those of seed 0")
assert shared.sum() == 3
PYTHON

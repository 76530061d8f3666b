#!/usr/bin/env bash
# Software:  ogbench 1.2.2 with mujoco 3.11.0: PointMaze and AntMaze, by `gym.make` and in `AsyncVectorEnv`.
# Expected:  `reset(seed=s)` decides task, start and goal, and environments of a vector have episodes of their own.
# Happens:   they come from NumPy's global generator, which `reset` does not seed: equal seeds give other episodes. Processes that
#            are forked begin with copies of that generator, so that all environments of a vector begin the same episodes.
# Who:       users who evaluate on fixed seeds, or collect and evaluate in parallel: N environments see as many starts as one.
# Seen:      seed 0 twice: 2 starts; seeds 0 to 3 in a vector of 4: 1 start and 1 goal
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages ogbench==1.2.2 mujoco==3.11.0 gymnasium==1.4.0 numpy==2.4.6
cat >"$folder/mazes.py" <<'PYTHON'
from importlib.metadata import version

import gymnasium as gym
import numpy as np
import ogbench  # noqa: F401


def different(rows):
    return len({tuple(np.round(row[:2], 6)) for row in rows})


def make():
    return gym.make("pointmaze-medium-v0")


if __name__ == "__main__":
    single = make()
    starts = [single.reset(seed=0)[0] for _ in range(8)]
    np.random.seed(0)
    again = [single.reset(seed=0)[0]]
    np.random.seed(0)
    again.append(single.reset(seed=7)[0])
    vector = gym.vector.AsyncVectorEnv([make] * 4, context="fork")
    rows, infos = vector.reset(seed=[0, 1, 2, 3])
    vector.close()
    found = different(starts), different(again), different(rows), different(infos["goal"])
    print(f"ogbench {version('ogbench')}: seed 0, 8 times: {found[0]} starts; seeds 0 and 7 with the same global numbers: {found[1]}")
    print(f"seeds 0 to 3 in a vector of 4: {found[2]} start, {found[3]} goal: {rows.round(2).tolist()}")
    assert found[0] > 1 and found[1:] == (1, 1, 1)
PYTHON
"$python" -W ignore "$folder/mazes.py"

#!/usr/bin/env bash
# Software:  ale-py 0.12.1 with gymnasium 1.4.0: `make` and `make_vec` of one environment.
# Expected:  `make_vec(id)` steps several environments of `make(id)`: the same observations and rewards.
# Happens:   where no `vectorization_mode` is given, it is another environment: four gray images of 84 x 84 in place of one color image
#            of 210 x 160, and rewards that are clipped to -1, 0 and 1. The specification (`spec.kwargs`) names none of it.
# Who:       users who report returns of a vector environment beside published scores: Ms. Pac-Man, whose dots give 10 points, seems
#            ten times worse.
# Seen:      ALE/MsPacman-v5, observations and rewards: make (210, 160, 3) [0.0, 10.0], make_vec (4, 84, 84) [0.0, 1.0],
#            sync (210, 160, 3) [0.0, 10.0], make_vec without clipping (4, 84, 84) [0.0, 10.0]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages ale-py==0.12.1 gymnasium==1.4.0 numpy==2.4.6
"$python" -W ignore - 2>/dev/null <<'PYTHON'
from importlib.metadata import version

import ale_py
import gymnasium as gym
import numpy as np

gym.register_envs(ale_py)
ID, STEPS = "ALE/MsPacman-v5", 120


def single():
    env, rewards = gym.make(ID), set()
    env.reset(seed=0)
    for step in range(STEPS):
        rewards.add(float(env.step(step // 10 % 4 + 1)[1]))
    return env.observation_space.shape, sorted(rewards)


def vector(**options):
    env, rewards = gym.make_vec(ID, num_envs=1, **options), set()
    assert "reward_clipping" in options or "reward_clipping" not in env.spec.kwargs
    env.reset(seed=0)
    for step in range(STEPS):
        rewards.add(float(env.step(np.array([step // 10 % 4 + 1]))[1][0]))
    return env.single_observation_space.shape, sorted(rewards)


found = {
    "make": single(),
    "make_vec": vector(),
    "sync": vector(vectorization_mode="sync"),
    "make_vec without clipping": vector(reward_clipping=False),
}
print(f"ale-py {version('ale-py')}, gymnasium {gym.__version__}: {found}")
assert found["make"] == found["sync"] == ((210, 160, 3), [0.0, 10.0])
assert found["make_vec"] == ((4, 84, 84), [0.0, 1.0])
assert found["make_vec without clipping"] == ((4, 84, 84), [0.0, 10.0])
PYTHON

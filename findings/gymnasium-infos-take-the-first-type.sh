#!/usr/bin/env bash
# Software:  gymnasium 1.4.0: infos of vector environments, synchronous and asynchronous.
# Expected:  an array of a type that holds the values of all environments.
# Happens:   the first environment that has a key decides the type of its array, and values of the others are converted: beside an
#            int 0, a distance of 0.7 becomes 0; beside True, a success of 0.5 becomes True. Arrays, too.
# Who:       users who log or learn from infos (distances, successes, costs) of environments that return `0` or `True` at times.
# Seen:      distance [0, 0] of 0 and 0.7; success [True, True] of True and 0.5; in the other order [0.7, 0.0] and [0.5, 1.0]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages gymnasium==1.4.0 numpy==2.4.6
"$python" - <<'PYTHON'
import gymnasium as gym
import numpy as np
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

INFOS = [
    {"distance": 0, "success": True, "cost": np.array([0, 0])},
    {"distance": 0.7, "success": 0.5, "cost": np.array([0.7, 2.5])},
]


class Task(gym.Env):
    observation_space = gym.spaces.Box(0, 1, (1,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def __init__(self, info):
        self.info = info

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), 0.0, False, False, self.info


def infos(kind, order):
    envs = kind([lambda info=INFOS[i]: Task(info) for i in order])
    envs.reset(seed=0)
    seen = envs.step(np.zeros((2, 1), np.float32))[4]
    envs.close()
    return [seen[name].tolist() for name in INFOS[0]]


if __name__ == "__main__":
    for kind in (SyncVectorEnv, AsyncVectorEnv):
        first, second = infos(kind, [0, 1]), infos(kind, [1, 0])
        print(f"gymnasium {gym.__version__}, {kind.__name__}: {first}; in the other order {second}")
        assert first == [[0, 0], [True, True], [[0, 0], [0, 2]]]
        assert second == [[0.7, 0.0], [0.5, 1.0], [[0.7, 2.5], [0.0, 0.0]]]
PYTHON

#!/usr/bin/env bash
# Software:  stable-worldmodel 0.1.1 (plain `pip install` lacks opencv and imageio, which its import needs).
# Expected:  `world.evaluate(episodes=N)` runs N whole episodes.
# Happens:   without `seed=` or `options=` nothing is reset: episodes that are under way are continued and counted.
# Who:       users who compare results here with the reference's. Here, episodes are always whole.
# Seen:      after 6 of 10 steps, evaluate(episodes=1) runs 4 steps; with seed=0 it runs 10
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages stable-worldmodel==0.1.1 imageio==2.38.1 opencv-python-headless==5.0.0.93
"$python" - 2>/dev/null <<'PYTHON'
from importlib.metadata import version

import gymnasium as gym
import numpy as np
import stable_worldmodel as swm

steps = 0


class TenSteps(gym.Env):
    observation_space = gym.spaces.Box(0, 100, (1,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        global steps
        self.at += 1
        steps += 1
        return np.full(1, self.at, np.float32), 0.0, self.at == 10, False, {}


class Still:
    def set_env(self, env):
        self.env = env

    def get_action(self, infos):
        return np.zeros(self.env.action_space.shape, np.float32)


gym.register("TenSteps-v0", TenSteps)
world = swm.World("TenSteps-v0", num_envs=1, add_pixels=False, max_episode_steps=50)
world.set_policy(Still())
found = {}
for seed in (None, 0):
    world.reset(seed=0)
    for _ in range(6):
        world.envs.step(np.zeros((1, 1), np.float32))
    steps = 0
    world.evaluate(episodes=1, seed=seed)
    found[seed] = steps
print(f"stable-worldmodel {version('stable-worldmodel')}: steps of the evaluated episode by seed: {found}")
assert found == {None: 4, 0: 10}
PYTHON

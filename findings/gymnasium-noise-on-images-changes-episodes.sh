#!/usr/bin/env bash
# Software:  gymnasium 1.4.0: wrappers that need random numbers (`AddWhiteNoise`, `ObstructView`, `StickyAction`).
# Expected:  noise on rendered images changes images only, and sticky actions of probability 0 change nothing.
# Happens:   they take numbers from the generator of the environment, so that its dynamics and the start of the next episode depend
#            on how often `render` was called.
# Who:       users who compare policies on images with and without distractors, or record videos of some episodes, on the same seed.
# Seen:      start of the second episode: 0.105 without, 1.960 and -0.544 with rendering, -0.536 with sticky actions of probability 0
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages gymnasium==1.4.0 numpy==2.4.6
"$python" -W ignore - <<'PYTHON'
import gymnasium as gym
import numpy as np
from gymnasium.wrappers import AddWhiteNoise, ObstructView, StickyAction


class Walk(gym.Env):
    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}
    render_mode = "rgb_array"
    observation_space = gym.spaces.Box(-10, 10, (1,), np.float64)
    action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.normal(size=1), {}

    def step(self, action):
        return self.np_random.normal(size=1), 0.0, False, False, {}

    def render(self):
        return np.zeros((4, 4, 3), np.uint8)


def second_start(env, rendered):
    env.reset(seed=0)
    for _ in range(2):
        if rendered:
            env.render()
        env.step(np.zeros(1, np.float32))
    return round(float(env.reset()[0][0]), 3)


found = {
    "plain": [second_start(Walk(), rendered) for rendered in (False, True)],
    "AddWhiteNoise": [second_start(AddWhiteNoise(Walk(), 0.1), rendered) for rendered in (False, True)],
    "ObstructView": [second_start(ObstructView(Walk(), 0.1, 2), rendered) for rendered in (False, True)],
    "StickyAction(0)": [second_start(StickyAction(Walk(), 0.0), rendered) for rendered in (False, True)],
}
print(f"gymnasium {gym.__version__}: start of the second episode, without and with rendering: {found}")
start = found["plain"][0]
assert found["plain"][1] == found["AddWhiteNoise"][0] == found["ObstructView"][0] == start
assert start not in (found["AddWhiteNoise"][1], found["ObstructView"][1], *found["StickyAction(0)"])
PYTHON

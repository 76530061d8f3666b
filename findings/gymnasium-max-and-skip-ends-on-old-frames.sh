#!/usr/bin/env bash
# Software:  gymnasium 1.4.0: `MaxAndSkipObservation`.
# Expected:  each observation is the maximum of the last two frames, as its manual says, also of those that end an episode.
# Happens:   only the frames skip - 1 and skip of a call are taken: where the episode ends before, the observation is that of the call before,
#            or of the last call of the episode before, or zeros; where it ends on frame skip - 1, it is mixed with that of the call before.
# Who:       users who learn from last observations: a truncated episode is valued at the state before, a world model sees no change for the
#            last action, and the frame of a success is never seen.
# Seen:      frame t is [t, -t], skip is 4: an episode of 10 frames ends on [8, -7] in place of [10, -9], one of 11 on [11, -8] in place of
#            [11, -10], one of 12 rightly on [12, -11]; one of 1 frame ends on zeros, or, after that of 12, on [12, -11]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages gymnasium==1.4.0 numpy==2.4.6
"$python" - <<'PYTHON'
import gymnasium
import numpy as np
from gymnasium.wrappers import MaxAndSkipObservation


class Count(gymnasium.Env):
    """Frame t is [t, -t]; episodes end after `lengths` frames, one after the other."""

    observation_space = gymnasium.spaces.Box(-100, 100, (2,))
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, *lengths):
        self.lengths = iter(lengths)

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        self.frame, self.length = 0, next(self.lengths)
        return np.zeros(2, np.float32), {}

    def step(self, action):
        self.frame += 1
        return np.array([self.frame, -self.frame], np.float32), 1.0, False, self.frame == self.length, {}


def last(*lengths):
    """The last observation of the last episode."""
    env = MaxAndSkipObservation(Count(*lengths))
    for _ in lengths:
        env.reset(seed=0)
        truncated = False
        while not truncated:
            observation, _, _, truncated, _ = env.step(0)
    return observation.astype(int).tolist()


first = {length: last(length) for length in (9, 10, 11, 12, 1)}
after = last(12, 1)
print(f"gymnasium {gymnasium.__version__}, last observation by length of the episode: {first}")
print(f"of an episode of 1 frame after one of 12: {after}; the frames there end on [1, -1]")
assert first == {9: [8, -7], 10: [8, -7], 11: [11, -8], 12: [12, -11], 1: [0, 0]} and after == [12, -11]
PYTHON

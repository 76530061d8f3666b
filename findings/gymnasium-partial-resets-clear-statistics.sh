#!/usr/bin/env bash
# Software:  gymnasium 1.4.0: `vector.RecordEpisodeStatistics` over `SyncVectorEnv` and `AsyncVectorEnv` with `AutoresetMode.DISABLED`.
# Expected:  `reset(options={"reset_mask": ended})` begins the episodes that ended, and the others go on, in their statistics, too.
# Happens:   the vector environment removes `reset_mask` from the dict that it is given. The wrapper, which looks at the dict afterwards, takes the
#            reset for one of all environments: running episodes count from there. A dict that is given twice resets all of them.
# Who:       users who evaluate by partial resets: returns and lengths are too small wherever episodes differ in length.
# Seen:      reward 1 per step, episodes of 3 and 5 steps: returns 3, 2, 1, 3, 1, 2 in place of 3, 5, 3, 3, 5, 3; after the second reset with one
#            dict, which names the first environment, the second is at frame 0 in place of 4
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages gymnasium==1.4.0 numpy==2.4.6
cat >"$folder/run.py" <<'PYTHON'
import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics


class Count(gymnasium.Env):
    """Observes the frame, rewards each step by 1."""

    observation_space = gymnasium.spaces.Box(0, 100, (1,))
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, length):
        self.length = length

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        self.frame = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.frame += 1
        return np.full(1, self.frame, np.float32), 1.0, False, self.frame == self.length, {}


def vector(kind, *lengths):
    return kind([lambda length=length: Count(length) for length in lengths], autoreset_mode=AutoresetMode.DISABLED)


def statistics(kind):
    """Returns as recorded, and as summed here."""
    envs = RecordEpisodeStatistics(vector(kind, 3, 5))
    envs.reset(seed=0)
    total, summed = np.zeros(2), []
    for _ in range(12):
        _, reward, _, ended, _ = envs.step(np.zeros(2, int))
        total += reward
        if ended.any():
            summed += total[ended].tolist()
            total[ended] = 0
            envs.reset(options={"reset_mask": ended})
    recorded = [float(value) for value in envs.return_queue]
    envs.close()
    return recorded, summed


def frames(kind):
    """Frames after a first and a second reset of the first environment by one dict, two steps before each."""
    envs, options, found = vector(kind, 9, 9), {"reset_mask": np.array([True, False])}, []
    envs.reset(seed=0)
    for _ in range(2):
        for _ in range(2):
            envs.step(np.zeros(2, int))
        found.append(envs.reset(options=options)[0].ravel().astype(int).tolist())
    envs.close()
    return found


if __name__ == "__main__":
    for kind in (SyncVectorEnv, AsyncVectorEnv):
        recorded, summed = statistics(kind)
        twice = frames(kind)
        print(f"gymnasium {gymnasium.__version__}, {kind.__name__}: returns recorded {recorded}, summed {summed}; "
              f"frames after resets of the first by one dict {twice}")
        assert recorded == [3, 2, 1, 3, 1, 2] and summed == [3, 5, 3, 3, 5, 3] and twice == [[0, 2], [0, 0]]
PYTHON
"$python" "$folder/run.py"

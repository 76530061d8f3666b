#!/usr/bin/env bash
# Software:  gymnasium 1.4.0: `NormalizeReward` of single and of vector environments.
# Expected:  the return by whose variance rewards are divided begins anew with each episode, as its class of vector environments does
#            under SAME_STEP.
# Happens:   it is cleared by termination only, so that it runs over all episodes that a time limit ends, and `reset` of a single
#            environment does not clear it. The last step of a terminated episode loses the return before it, and its reward goes
#            into the next episode.
# Who:       users who train on tasks with a time limit by scripts that normalize rewards: the scale depends on the autoreset mode.
# Seen:      10 steps of reward 1 per episode: greatest return 8.6 (SAME_STEP), 95.1 (single), 93.6 (NEXT_STEP); scale 2.7, 25.6, 25.4
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages gymnasium==1.4.0 numpy==2.4.6
"$python" -W ignore - <<'PYTHON'
import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import NormalizeReward
from gymnasium.wrappers.vector import NormalizeReward as NormalizeRewards

STEPS, ACTION = 10, np.zeros(1, np.float32)


class Task(gym.Env):
    observation_space = action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        self.at = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.at += 1
        return np.zeros(1, np.float32), 1.0, False, self.at == STEPS, {}


def single():
    env, returns = NormalizeReward(Task(), gamma=0.99), []
    for _ in range(30):
        env.reset()
        for _ in range(STEPS):
            env.step(ACTION)
            returns.append(float(env.discounted_reward[0]))
    return max(returns), float(np.sqrt(env.return_rms.var))


def vector(mode):
    env, returns = NormalizeRewards(SyncVectorEnv([Task], autoreset_mode=mode), gamma=0.99), []
    env.reset()
    for _ in range(30 * STEPS):
        env.step(ACTION[None])
        returns.append(float(env.accumulated_reward[0]))
    return max(returns), float(np.sqrt(env.return_rms.var))


found = {"single": single(), "NEXT_STEP": vector(AutoresetMode.NEXT_STEP), "SAME_STEP": vector(AutoresetMode.SAME_STEP)}
print(f"gymnasium {gym.__version__}: greatest discounted return and the scale, {STEPS} steps of reward 1 per episode: {found}")
most = sum(0.99**step for step in range(STEPS))
assert found["SAME_STEP"][0] < most and found["single"][0] > 5 * most and found["NEXT_STEP"][0] > 5 * most
assert found["single"][1] > 5 * found["SAME_STEP"][1] and found["NEXT_STEP"][1] > 5 * found["SAME_STEP"][1]
PYTHON

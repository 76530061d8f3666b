#!/usr/bin/env bash
# Software:  gymnasium 1.4.0: vector environments, with code written for 0.29 (CleanRL and its copies).
# Expected:  `infos["final_observation"]` and `infos["final_info"]` when an episode ends, or an error.
# Happens:   by default (NextStep) neither is there, and `if "final_info" in infos` is just never true: no episode is logged, and
#            no value is bootstrapped at a truncation. The step after an end ignores its action, with reward 0. With SameStep the
#            names are `final_obs` and `final_info`.
# Who:       users who train on this package's vector environments by such code.
# Seen:      NextStep: []; SameStep: ['_final_info', '_final_obs', 'final_info', 'final_obs']
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages gymnasium==1.4.0 numpy==2.4.6
"$python" - <<'PYTHON'
import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

found, rewards = {}, []
for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
    options = {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": mode}, "max_episode_steps": 3}
    envs = gym.make_vec("CartPole-v1", num_envs=2, **options)
    envs.reset(seed=0)
    names = set()
    for _ in range(4):
        _, reward, _, _, infos = envs.step(np.array([0, 1]))
        names |= set(infos)
    found[mode.value], rewards = sorted(names), [*rewards, reward.tolist()]
print(f"gymnasium {gym.__version__}: {found}; rewards of the step after the end: {rewards}")
assert found["NextStep"] == [] and "final_obs" in found["SameStep"] and "final_observation" not in found["SameStep"]
assert rewards == [[0, 0], [1, 1]]
PYTHON

#!/usr/bin/env bash
# Software:  gymnasium 1.4.0: `env.reset(seed=s)` with `env.action_space.seed(s)`, as its examples have it.
# Expected:  starts and sampled actions are independent.
# Happens:   both make the same generator of the same number, so that the first values of one are those of the other: the first action of
#            Pendulum is the initial angle times 2 / pi. In a vector environment, this is so for environment 0.
# Who:       users who collect data by random actions with a seed per episode, and fit a model of the dynamics to them.
# Seen:      correlation of angle and action 1.0 over 2000 seeds; speed gained per torque 0.50, where 0.15 is right
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages gymnasium==1.4.0 numpy==2.4.6
"$python" - <<'PYTHON'
import gymnasium as gym
import numpy as np

env = gym.make("Pendulum-v1")


def first_step(seed, seed_of_actions):
    env.reset(seed=seed)
    env.action_space.seed(seed_of_actions)
    angle, speed = env.unwrapped.state
    action = env.action_space.sample()
    env.step(action)
    return angle, action[0], env.unwrapped.state[1] - speed


def correlation_and_slope(shift):
    angles, actions, gains = np.array([first_step(seed, seed + shift) for seed in range(2000)]).T
    return float(np.corrcoef(angles, actions)[0, 1]), float(np.polyfit(actions, gains, 1)[0])


def first_of_vector(seed):
    envs.reset(seed=seed)
    envs.action_space.seed(seed)
    return envs.envs[0].unwrapped.state[0] / np.pi, envs.action_space.sample()[0, 0] / 2


envs = gym.make_vec("Pendulum-v1", 4, vectorization_mode="sync")
same, other = correlation_and_slope(0), correlation_and_slope(10**6)
vector = np.array([first_of_vector(seed) for seed in range(0, 400, 4)])
print(f"gymnasium {gym.__version__}: one seed for both: correlation {same[0]:.3f}, speed per torque {same[1]:.3f}")
print(f"a seed for each: correlation {other[0]:.3f}, speed per torque {other[1]:.3f}; the equations of Pendulum have 0.150")
print(f"environment 0 of 4: largest difference of angle / pi and action / 2: {np.ptp(vector, axis=1).max():.1e}")
assert same[0] > 0.9999 and same[1] > 0.4 and abs(other[0]) < 0.1 and abs(other[1] - 0.15) < 0.03
assert np.ptp(vector, axis=1).max() < 1e-6
PYTHON

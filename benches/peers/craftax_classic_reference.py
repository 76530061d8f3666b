"""Measures Craftax-Classic on JAX, inside the virtual environment that craftax_classic.py makes.

Not started by hand. Prints one JSON object per round for every line that it reads: steps per second of CPU time of one environment
with random actions, compiled and called as the reference's wrapper does it, on one thread.
"""

import json
import os
import sys
import time

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"

import jax  # noqa: E402
import numpy as np  # noqa: E402
from craftax.craftax_classic.envs.craftax_symbolic_env import CraftaxClassicSymbolicEnvNoAutoReset  # noqa: E402

NAME = "Craftax-Classic-Symbolic-v1"
STEPS = 100

env = CraftaxClassicSymbolicEnvNoAutoReset()
params = env.default_params


@jax.jit
def reset(key):
    key, other = jax.random.split(key)
    return *env.reset(other, params), key


@jax.jit
def step(key, state, action):
    key, other = jax.random.split(key)
    return *env.step(other, state, action, params), key


def rate(seconds):
    """Steps per second; resets do not count."""
    actions = np.random.default_rng(0)
    spent, count, episode = 0.0, 0, 0
    while spent < seconds:
        _, state, key = reset(jax.random.PRNGKey(episode))
        episode += 1
        start = time.process_time()
        for _ in range(STEPS):
            observation, state, reward, done, info, key = step(key, state, int(actions.integers(17)))
            np.asarray(observation), float(reward), {name: np.asarray(value) for name, value in info.items()}
            count += 1
            if bool(done):
                break
        spent += time.process_time() - start
    return count / spent


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    rate(0.1)
    for line in sys.stdin:
        print(json.dumps({f"{NAME} one": rate(float(line))}), file=answers, flush=True)


if __name__ == "__main__":
    main()

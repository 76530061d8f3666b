#!/usr/bin/env bash
# Software:  brax 0.14.2: `envs.create`, whose environments reset by themselves (`AutoResetWrapper`, which trainings wrap by, too).
# Expected:  each episode begins in a new random state, as `reset` gives it: the manual says that environments which are done are reset.
# Happens:   the state of the first `reset` is kept and set again: every episode of an environment begins in the same state, and the key of
#            the reset does not move on. New states come with the next call of `reset` only.
# Who:       users who collect datasets, train or evaluate over several episodes: of 8 environments and any number of episodes there are 8
#            initial states, and goals that `reset` draws stay the same; averages over episodes look surer than they are.
# Seen:      4 environments with episodes of 5 steps: 6 episodes each begin in 4 states together; 4 calls of `reset` give 16
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages brax==0.14.2 jax==0.12.0.1 numpy==2.4.6
JAX_PLATFORMS=cpu "$python" -W ignore - <<'PYTHON'
from importlib.metadata import version

import jax
import numpy as np
from brax import envs

ENVIRONMENTS, STEPS, EPISODES = 4, 5, 6
env = envs.create("inverted_pendulum", backend="positional", episode_length=STEPS, batch_size=ENVIRONMENTS)
reset, step = jax.jit(env.reset), jax.jit(env.step)


def starts(key):
    """First observations of all episodes, [episodes * environments, 4]."""
    state = reset(key)
    found = [np.asarray(state.obs)]
    for _ in range(STEPS * (EPISODES - 1)):
        state = step(state, jax.numpy.ones((ENVIRONMENTS, env.action_size)))
        if state.done.any():
            assert state.done.all()
            found.append(np.asarray(state.obs))
    assert len(found) == EPISODES
    return np.concatenate(found)


def different(observations):
    return len(np.unique(observations.round(6), axis=0))


by_episodes = different(starts(jax.random.PRNGKey(0)))
by_reset = different(np.concatenate([np.asarray(reset(jax.random.PRNGKey(seed)).obs) for seed in range(4)]))
print(f"brax {version('brax')}, {ENVIRONMENTS} environments with {EPISODES} episodes each: {by_episodes} initial states")
print(f"4 calls of reset: {by_reset}")
assert by_episodes == ENVIRONMENTS and by_reset == 16
PYTHON

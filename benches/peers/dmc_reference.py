"""Measures dm_control and the Python reference's World on it, inside the virtual environment that dmc.py makes.

Not started by hand. Prints one JSON object for every line that it reads, a number of seconds: steps per second of CPU time
of `dm_control`'s own environments (`control/…`), and of a world of one environment without images (`world/…`, two control
steps each). Resets stand outside of the timed regions; actions are random and drawn beforehand.
"""

import json
import os
import sys
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np  # noqa: E402
import stable_worldmodel as swm  # noqa: E402
import torch  # noqa: E402
from dm_control import suite  # noqa: E402
from stable_worldmodel.policy import RandomPolicy  # noqa: E402

torch.set_num_threads(1)
EPISODE_STEPS = 100
DOMAINS = {"cheetah": ("run", "Cheetah"), "humanoid": ("walk", "Humanoid")}


def control(domain, task):
    env = suite.load(domain, task, task_kwargs={"random": 0})
    spec = env.action_spec()
    actions = np.random.default_rng(1).uniform(-1, 1, (EPISODE_STEPS, *spec.shape))

    def episode(_):
        env.reset()
        start = time.process_time()
        for action in actions:
            env.step(action)
        return time.process_time() - start

    return episode


def world(name):
    world = swm.World(f"swm/{name}DMControl-v0", 1, max_episode_steps=10 * EPISODE_STEPS, add_pixels=False)
    world.set_policy(RandomPolicy(seed=0))

    def episode(seed):
        world.reset(seed=seed)
        start = time.process_time()
        for _ in range(EPISODE_STEPS):
            # What the world's own loop does at each step: it has no public method for one.
            world.infos = world.envs.step(world.policy.get_action(world.infos))[-1]
        return time.process_time() - start

    return episode


def rate(seconds, episode):
    episode(0)
    spent, count = 0.0, 0
    while spent < seconds:
        count += 1
        spent += episode(count)
    return count * EPISODE_STEPS / spent


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    cases = {}
    for domain, (task, name) in DOMAINS.items():
        cases[f"control/{domain}"] = control(domain, task)
        cases[f"world/{domain}"] = world(name)
    for line in sys.stdin:
        seconds = float(line)
        print(json.dumps({name: rate(seconds, case) for name, case in cases.items()}), file=answers, flush=True)


if __name__ == "__main__":
    main()

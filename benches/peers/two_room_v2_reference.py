"""Measures TwoRoom in the Python reference of August 2026, inside the virtual environment that two_room_v2.py makes.

Not started by hand. Prints one JSON object per round for every line that it reads: steps and resets per second of
CPU time, of a world of one environment with 64 x 64 images and random actions, on one thread.
"""

import json
import os
import sys
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import stable_worldmodel as swm  # noqa: E402
import torch  # noqa: E402
from stable_worldmodel.policy import RandomPolicy  # noqa: E402

torch.set_num_threads(1)
EPISODE_STEPS = 100


def rate(seconds, work):
    """Calls `work`, which returns the seconds that count and for how much, until `seconds` are spent."""
    work(0)
    spent, count, episode = 0.0, 0, 0
    while spent < seconds:
        episode += 1
        took, done = work(episode)
        spent, count = spent + took, count + done
    return count / spent


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    world = swm.World("swm/TwoRoom-v1", 1, image_shape=(64, 64), max_episode_steps=10 * EPISODE_STEPS)
    world.set_policy(RandomPolicy(seed=0))

    def reset(episode):
        start = time.process_time()
        world.reset(seed=episode)
        return time.process_time() - start, 1

    def steps(episode):
        """What the world's own loop does at each step: it has no public method for one."""
        world.reset(seed=episode)
        start = time.process_time()
        for _ in range(EPISODE_STEPS):
            world.infos = world.envs.step(world.policy.get_action(world.infos))[-1]
        return time.process_time() - start, EPISODE_STEPS

    for line in sys.stdin:
        seconds = float(line)
        print(json.dumps({"step": rate(seconds, steps), "reset": rate(seconds, reset)}), file=answers, flush=True)


if __name__ == "__main__":
    main()

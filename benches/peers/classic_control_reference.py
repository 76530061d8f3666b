"""Measures Gymnasium's classic control, inside the virtual environment that classic_control.py makes.

Not started by hand. Prints one JSON object per round for every line that it reads: steps per second of CPU time with random
actions, without images and with images of 64 x 64, on one thread.
"""

import json
import os
import sys
import time

os.environ["SDL_VIDEODRIVER"] = "dummy"

import gymnasium  # noqa: E402
from PIL import Image  # noqa: E402

NAMES = ["CartPole-v1", "MountainCar-v0", "MountainCarContinuous-v0", "Acrobot-v1", "Pendulum-v1"]
STEPS = 100


def rate(name, with_images, seconds):
    """Steps per second; resets do not count."""
    env = gymnasium.make(name, render_mode="rgb_array" if with_images else None)
    env.action_space.seed(0)
    spent, count, episode = 0.0, 0, 0
    while spent < seconds:
        env.reset(seed=episode)
        episode += 1
        start = time.process_time()
        for _ in range(STEPS):
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
            if with_images:
                Image.fromarray(env.render()).resize((64, 64), Image.BILINEAR)
            count += 1
            if terminated or truncated:
                break
        spent += time.process_time() - start
    env.close()
    return count / spent


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        seconds = float(line)
        measured = {}
        for name in NAMES:
            measured[f"{name} bare"] = rate(name, False, seconds)
            measured[f"{name} 64"] = rate(name, True, seconds)
        print(json.dumps(measured), file=answers, flush=True)


if __name__ == "__main__":
    main()

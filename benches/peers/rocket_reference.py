"""Measures PyFlyt's rocket landing, inside the virtual environment that rocket.py makes.

Not started by hand. Prints one JSON object per round for every line that it reads: steps per second of CPU time with random
actions, without images and with images of 64 x 64, and resets per second, on one thread.
"""

import json
import os
import sys
import time

import gymnasium
import PyFlyt.gym_envs  # noqa: F401

NAME = "PyFlyt/Rocket-Landing-v4"
STEPS = 100


def rates(with_images, seconds):
    """Steps and resets per second; steps do not count resets."""
    images = {"render_mode": "rgb_array", "render_resolution": (64, 64)} if with_images else {}
    env = gymnasium.make(NAME, disable_env_checker=True, **images)
    env.action_space.seed(0)
    stepping, resetting, steps, resets = 0.0, 0.0, 0, 0
    while stepping < seconds:
        start = time.process_time()
        env.reset(seed=resets)
        resets += 1
        begin = time.process_time()
        resetting += begin - start
        for _ in range(STEPS):
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
            if with_images:
                env.render()
            steps += 1
            if terminated or truncated:
                break
        stepping += time.process_time() - begin
    env.close()
    return steps / stepping, resets / resetting


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        seconds = float(line)
        bare, reset = rates(False, seconds)
        measured = {"bare": bare, "reset": reset, "64": rates(True, seconds)[0]}
        print(json.dumps(measured), file=answers, flush=True)


if __name__ == "__main__":
    main()

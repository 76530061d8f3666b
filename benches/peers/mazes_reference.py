"""Measures OGBench's humanoid maze and AntSoccer, inside the virtual environment that mazes.py makes.

Not started by hand. Prints one JSON object per round for every line that it reads: steps per second of CPU time with random
actions, without images and with images of 64 x 64 by MuJoCo's own renderer, and resets per second, on one thread.
"""

import json
import os
import sys
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"
os.environ.setdefault("MUJOCO_GL", "egl")

import numpy as np  # noqa: E402
from ogbench.locomaze.maze import make_maze_env  # noqa: E402

# By the names of the environments here: body, kind and maze.
MADE = {"OGBHumanoidMaze-v0": ("humanoid", "maze", "large"), "OGBAntSoccer-v0": ("ant", "ball", "arena")}
STEPS = 50


def rates(body, kind, maze, with_images, seconds):
    """Steps and resets per second; steps do not count resets."""
    images = {"width": 64, "height": 64, "camera_name": "back"} if with_images else {}
    env = make_maze_env(body, kind, maze_type=maze, terminate_at_goal=False, **images)
    generator = np.random.default_rng(0)
    stepping, resetting, steps, resets = 0.0, 0.0, 0, 0
    while stepping < seconds:
        start = time.process_time()
        env.reset()
        resets += 1
        begin = time.process_time()
        resetting += begin - start
        for action in generator.uniform(-1, 1, (STEPS if not with_images else 4, env.model.nu)).astype(np.float32):
            env.step(action)
            if with_images:
                env.render()
            steps += 1
        stepping += time.process_time() - begin
    return steps / stepping, resets / resetting


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        seconds, measured = float(line), {}
        for name, made in MADE.items():
            bare, reset = rates(*made, False, seconds)
            measured |= {f"{name} bare": bare, f"{name} reset": reset, f"{name} images": rates(*made, True, seconds)[0]}
        print(json.dumps(measured), file=answers, flush=True)


if __name__ == "__main__":
    main()

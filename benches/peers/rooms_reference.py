"""Measures the small 2D environments of the Python reference, inside the virtual environments that rooms.py and piecewise.py use.

Not started by hand. Prints one JSON object per round for every line that it reads: of each environment that the installed release
has, steps per second of CPU time with random actions, without images and with images of 64 x 64, and resets, on one thread.
"""

import importlib.util
import json
import os
import sys
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"
os.environ.update(SDL_VIDEODRIVER="dummy", PYGAME_HIDE_SUPPORT_PROMPT="1", MPLBACKEND="agg")

from without_torch import stand_in_for_torch  # noqa: E402

if importlib.util.find_spec("torch") is None:
    stand_in_for_torch()
else:
    import torch

    torch.set_num_threads(1)

import gymnasium  # noqa: E402
import stable_worldmodel  # noqa: E402, F401
from loguru import logger  # noqa: E402
from PIL import Image  # noqa: E402

logger.remove()
# SimplePointMaze is the same in both releases; it is measured in the one that has SimpleNavigation.
RELEASES = [["SimpleNavigation-v0", "SimplePointMaze-v0"], ["Piecewise-v0"]]
NAMES = next(names for names in RELEASES if all(f"swm/{name}" in gymnasium.registry for name in names))
STEPS = 100


def rates(name, with_images, seconds):
    """Steps and resets per second; steps do not count resets."""
    env = gymnasium.make(f"swm/{name}", render_mode="rgb_array")
    env.action_space.seed(0)
    stepping, resetting, steps, resets = 0.0, 0.0, 0, 0
    while stepping < seconds:
        start = time.process_time()
        env.reset(seed=resets)
        begin = time.process_time()
        resets, resetting = resets + 1, resetting + begin - start
        for _ in range(STEPS):
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
            if with_images:
                Image.fromarray(env.render()).resize((64, 64), Image.BILINEAR)
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
        seconds, measured = float(line), {}
        for name in NAMES:
            bare, reset = rates(name, False, seconds)
            measured |= {f"{name} bare": bare, f"{name} reset": reset, f"{name} images": rates(name, True, seconds)[0]}
        print(json.dumps(measured), file=answers, flush=True)


if __name__ == "__main__":
    main()

"""Measures OGBench's manipulation environments, inside the virtual environment that ogb.py makes.

Not started by hand. Prints one JSON object per round for every line that it reads: steps per second of CPU time, of
one environment with random actions on one thread, without images and with images drawn by MuJoCo's own renderer. These are the
environments that the reference wraps; its own world adds to each step what is not measured here.
"""

import json
import os
import sys
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"
os.environ.setdefault("MUJOCO_GL", "egl")

import numpy as np  # noqa: E402
from ogbench.manipspace.envs.cube_env import CubeEnv  # noqa: E402
from ogbench.manipspace.envs.scene_env import SceneEnv  # noqa: E402


def environment(name, side):
    kind, env_type = {"cube": (CubeEnv, "single"), "scene": (SceneEnv, "scene")}[name]
    sizes = {} if side is None else {"width": side, "height": side}
    return kind(env_type=env_type, ob_type="states", mode="data_collection", terminate_at_goal=False, **sizes)


def rate(env, side, seconds):
    """Steps per second; resets do not count."""
    generator = np.random.default_rng(0)
    env.reset(seed=0)
    steps = 100 if side is None else 4
    spent, count = 0.0, 0
    while spent < seconds:
        env.reset()
        actions = generator.uniform(-1, 1, (steps, 5)).astype(np.float32)
        start = time.process_time()
        for action in actions:
            env.step(action)
            if side is not None:
                env.render(camera="front_pixels")
        spent, count = spent + time.process_time() - start, count + steps
    return count / spent


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    environments = {side: environment(sys.argv[1], side) for side in (None, 64, 224)}
    for line in sys.stdin:
        rates = {str(side).lower(): rate(env, side, float(line)) for side, env in environments.items()}
        print(json.dumps(rates), file=answers, flush=True)


if __name__ == "__main__":
    main()

"""Measures metaworld's environments, inside the virtual environment that meta_world.py makes.

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

import metaworld  # noqa: E402
import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from metaworld import sawyer_xyz_env  # noqa: E402

NAMES = {"MetaWorldPickPlace-v0": "pick-place-v3", "MetaWorldDrawerOpen-v0": "drawer-open-v3"}
STEPS = 200


def reset_mocap_welds(self):
    """As the package's own, which assigns 11 numbers to rows that have 12 since MuJoCo 3.17."""
    for index, kind in enumerate(self.model.eq_type):
        if int(kind) == int(mujoco.mjtEq.mjEQ_WELD):
            self.model.eq_data[index][:11] = [0, 0, 0, 0, 0, 0, -1, 0, 0, 0, 5]


sawyer_xyz_env.SawyerMocapBase.reset_mocap_welds = reset_mocap_welds


def rates(name, with_images, seconds):
    """Steps and resets per second; steps do not count resets."""
    benchmark = metaworld.MT1(name, seed=0)
    images = {"render_mode": "rgb_array", "width": 64, "height": 64, "camera_name": "corner2"} if with_images else {}
    env = benchmark.train_classes[name](**images)
    generator = np.random.default_rng(0)
    stepping, resetting, steps, resets = 0.0, 0.0, 0, 0
    while stepping < seconds:
        env.set_task(benchmark.train_tasks[resets % 50])
        start = time.process_time()
        env.reset()
        resets += 1
        begin = time.process_time()
        resetting += begin - start
        for action in generator.uniform(-1, 1, (4 if with_images else STEPS, 4)).astype(np.float32):
            env.step(action)
            if with_images:
                env.render()
            steps += 1
        stepping += time.process_time() - begin
    env.close()
    return steps / stepping, resets / resetting


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        seconds, measured = float(line), {}
        for name, made in NAMES.items():
            bare, reset = rates(made, False, seconds)
            measured |= {f"{name} bare": bare, f"{name} reset": reset, f"{name} images": rates(made, True, seconds)[0]}
        print(json.dumps(measured), file=answers, flush=True)


if __name__ == "__main__":
    main()

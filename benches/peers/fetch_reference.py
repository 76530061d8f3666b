"""Measures gymnasium-robotics' Fetch environments, inside the virtual environment that fetch.py makes.

Not started by hand. Prints one JSON object per round for every line that it reads: steps per second of CPU time with random
actions, without images and with images by MuJoCo's own renderer, and resets per second, on one thread. Images have the size
in which the reference draws them, 480 x 480, before it makes them smaller (which is not measured).
"""

import json
import os
import sys
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"
os.environ.setdefault("MUJOCO_GL", "egl")

import gymnasium  # noqa: E402
import gymnasium_robotics  # noqa: E402
import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from gymnasium_robotics.utils import mujoco_utils  # noqa: E402

# By the names of the reference; the package calls what runs on these bindings of MuJoCo v4.
NAMES = {"FetchPush-v3": "FetchPush-v4", "FetchPickAndPlace-v3": "FetchPickAndPlace-v4"}
STEPS = 50


def reset_mocap2body_xpos(model, data):
    """As the package's own, which compares an enumeration with a NumPy integer in a way that MuJoCo 3.17 made false."""
    for kind, first, second in zip(model.eq_type, model.eq_obj1id, model.eq_obj2id):
        if int(kind) == int(mujoco.mjtEq.mjEQ_WELD):
            mocap, body = model.body_mocapid[first], second
            if mocap == -1:
                mocap, body = model.body_mocapid[second], first
            data.mocap_pos[mocap][:] = data.xpos[body]
            data.mocap_quat[mocap][:] = data.xquat[body]


def joint_range(model, name, address, ball, hinge):
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    kind, first = int(model.jnt_type[joint]), address[joint]
    count = {int(mujoco.mjtJoint.mjJNT_FREE): ball[0], int(mujoco.mjtJoint.mjJNT_BALL): ball[1]}.get(kind, hinge)
    return first, first + count


def set_joint_qpos(model, data, name, value):
    first, last = joint_range(model, name, model.jnt_qposadr, (7, 4), 1)
    data.qpos[first:last] = np.array(value)


def get_joint_qpos(model, data, name):
    first, last = joint_range(model, name, model.jnt_qposadr, (7, 4), 1)
    return data.qpos[first:last].copy()


def get_joint_qvel(model, data, name):
    first, last = joint_range(model, name, model.jnt_dofadr, (6, 3), 1)
    return data.qvel[first:last].copy()


for function in (reset_mocap2body_xpos, set_joint_qpos, get_joint_qpos, get_joint_qvel):
    setattr(mujoco_utils, function.__name__, function)


def rates(name, with_images, seconds):
    """Steps and resets per second; steps do not count resets."""
    images = {"render_mode": "rgb_array", "width": 480, "height": 480} if with_images else {}
    env = gymnasium.make(name, disable_env_checker=True, **images)
    generator = np.random.default_rng(0)
    stepping, resetting, steps, resets = 0.0, 0.0, 0, 0
    while stepping < seconds:
        start = time.process_time()
        env.reset(seed=resets)
        resets += 1
        begin = time.process_time()
        resetting += begin - start
        for action in generator.uniform(-1, 1, (STEPS if not with_images else 4, 4)).astype(np.float32):
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
    gymnasium.register_envs(gymnasium_robotics)
    for line in sys.stdin:
        seconds, measured = float(line), {}
        for name, made in NAMES.items():
            bare, reset = rates(made, False, seconds)
            measured |= {f"{name} bare": bare, f"{name} reset": reset, f"{name} images": rates(made, True, seconds)[0]}
        print(json.dumps(measured), file=answers, flush=True)


if __name__ == "__main__":
    main()

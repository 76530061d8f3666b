#!/usr/bin/env bash
# Software:  mujoco 4.0.0 (since 3.12) with NumPy, and gymnasium-robotics 1.4.2.
# Expected:  a joint type of the model, an integer of NumPy, is found in a tuple of MuJoCo's enums.
# Happens:   `np.int32(3) == enum` is True and `enum == np.int32(3)` is False, so `in` fails, and gymnasium-robotics makes no Fetch.
# Who:       users who compare Fetch here with gymnasium-robotics; code that checks joint types by `in`.
# Seen:      number == enum: True, enum == number: False; FetchReach-v4: AssertionError in set_joint_qpos
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages mujoco==4.0.0 gymnasium-robotics==1.4.2 gymnasium==1.4.0
"$python" - 2>/dev/null <<'PYTHON'
import traceback

import gymnasium as gym
import gymnasium_robotics
import mujoco
import numpy as np

enum = mujoco.mjtJoint.mjJNT_HINGE
number = np.int32(int(enum))
print(f"mujoco {mujoco.__version__}: number == enum: {number == enum}, enum == number: {enum == number}, in: {number in (enum,)}")
assert number == enum and not enum == number
gym.register_envs(gymnasium_robotics)
try:
    gym.make("FetchReach-v4")
except AssertionError:
    place = traceback.format_exc().splitlines()[-4:-1]
    print("FetchReach-v4: AssertionError", " ".join(line.strip() for line in place))
else:
    raise SystemExit("FetchReach-v4 is made: changed")
PYTHON

#!/usr/bin/env bash
# Software:  pin 4.1.0 (Pinocchio) and mujoco 4.0.0: joints of one URDF.
# Expected:  both have the joints in the order of the file, so that a vector of positions means the same.
# Happens:   Pinocchio sorts the joints below a link by their names as texts, so that j10 comes before j9 and left before right; MuJoCo
#            keeps the order of the file. A continuous joint has two numbers (cosine and sine) in Pinocchio and one in MuJoCo.
# Who:       users who compute kinematics, dynamics or inverse kinematics by Pinocchio on positions that MuJoCo or a robot has given.
# Seen:      MuJoCo right, left, spin, j9, j10 (5 numbers), Pinocchio j10, j9, left, right, spin (6 numbers); arms of equal limits are
#            swapped without an error
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
"$python" - "$folder/robot.urdf" <<'PYTHON'
import sys

import mujoco
import numpy as np
import pinocchio

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
JOINTS = {"right": "revolute", "left": "revolute", "spin": "continuous", "j9": "revolute", "j10": "revolute"}
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def robot(joints):
    text = f'<robot name="r"><link name="base">{INERTIAL}</link>'
    for i, (name, kind) in enumerate(joints.items()):
        text += f'<link name="{name}_link">{INERTIAL}</link><joint name="{name}" type="{kind}"><parent link="base"/>'
        text += f'<child link="{name}_link"/><origin xyz="0 {i} 0"/><axis xyz="0 0 1"/>{LIMIT}</joint>'
    with open(sys.argv[1], "w") as file:
        file.write(text + "</robot>")
    return pinocchio.buildModelFromUrdf(sys.argv[1]), mujoco.MjModel.from_xml_path(sys.argv[1])


model, simulated = robot(JOINTS)
by_pinocchio = list(model.names)[1:]
by_mujoco = [simulated.joint(i).name for i in range(simulated.njnt)]
print(f"pin {pinocchio.__version__}: {by_pinocchio}, {model.nq} numbers; mujoco {mujoco.__version__}: {by_mujoco}, {simulated.nq} numbers")

model, simulated = robot({"right": "revolute", "left": "revolute"})
positions, data = np.array([0.7, 0.0]), mujoco.MjData(simulated)
data.qpos[:] = positions
mujoco.mj_forward(simulated, data)
kinematics = model.createData()
pinocchio.forwardKinematics(model, kinematics, positions)
turned = {}
for name in ("right", "left"):
    rotation = kinematics.oMi[model.getJointId(name)].rotation
    turned[name] = float(np.arctan2(rotation[1, 0], rotation[0, 0])), float(data.joint(name).qpos[0])
print(f"angles of the positions {positions} by Pinocchio and MuJoCo: {turned}")
assert by_mujoco == list(JOINTS) and by_pinocchio == sorted(JOINTS) and (model.nq, simulated.nq) == (2, 2)
assert np.allclose(turned["right"], [0, 0.7]) and np.allclose(turned["left"], [0.7, 0])
PYTHON

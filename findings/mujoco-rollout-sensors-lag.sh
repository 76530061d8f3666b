#!/usr/bin/env bash
# Software:  mujoco 4.0.0: `mujoco.rollout`.
# Expected:  `state[:, t]` and `sensordata[:, t]`, returned by one call, belong to the same time.
# Happens:   a step computes sensors before it integrates: `sensordata[:, t]` is of the state before `state[:, t]`. Sensors of the
#            last state are not returned; those of the initial state are at index 0.
# Who:       users who make datasets, or costs of planners, of pairs of state and sensors.
# Seen:      a slider at speed 1 with steps of 0.02: joint 0.02 0.04 0.06 0.08, its jointpos sensor 0.00 0.02 0.04 0.06
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages mujoco==4.0.0 numpy==2.4.6
"$python" - <<'PYTHON'
import mujoco
import numpy as np
from mujoco import rollout

model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <option timestep="0.02" gravity="0 0 0"/>
  <worldbody><body><joint name="slider" type="slide" axis="1 0 0"/><geom size="0.1"/></body></worldbody>
  <sensor><jointpos joint="slider"/></sensor>
</mujoco>""")
data = mujoco.MjData(model)
data.qvel[0] = 1
kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
start = np.empty(mujoco.mj_stateSize(model, kind))
mujoco.mj_getState(model, data, start, kind)
state, sensors = rollout.rollout(model, data, start[None], nstep=4)
joint, sensor = state[0, :, 1].round(9).tolist(), sensors[0, :, 0].round(9).tolist()
print(f"mujoco {mujoco.__version__}: joint {joint}, its sensor {sensor}")
assert joint == [0.02, 0.04, 0.06, 0.08] and sensor == [0, 0.02, 0.04, 0.06]
PYTHON

#!/usr/bin/env bash
# Software:  mujoco 4.0.0: `MjSpec.to_xml` and `mj_saveLastXML`.
# Expected:  the XML that a model writes makes the same model.
# Happens:   numbers have 6 significant digits (0.7071067811865 becomes 0.707107), so that it is another model: sizes, masses and all
#            that follows from them differ from the sixth digit on, and motion that does not settle is another one soon.
# Who:       users who keep a model's XML beside recorded states or actions (robosuite and robomimic do), and replay them in it.
# Seen:      a double pendulum by the XML of its model: 2e-5 rad apart after 2 s, 0.06 after 6 s, 3.3 after 8 s; by its own XML 0
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages mujoco==4.0.0 numpy==2.4.6
"$python" - "$folder" <<'PYTHON'
import sys

import mujoco
import numpy as np

XML = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body pos="0 0 2"><joint axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 0.7071067811865" size="0.05"/><body pos="0 0 0.7071067811865"><joint axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 0.5773502691896" size="0.05"/></body></body></worldbody></mujoco>"""


def angles(model):
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3, 0.5
    found = []
    for _ in range(4000):
        mujoco.mj_step(model, data)
        found.append(data.qpos.copy())
    return np.array(found)


spec = mujoco.MjSpec.from_string(XML)
model = spec.compile()
written = spec.to_xml()
mujoco.mj_saveLastXML(f"{sys.argv[1]}/last.xml", mujoco.MjModel.from_xml_string(XML))
mujoco.mj_saveModel(model, f"{sys.argv[1]}/model.mjb")
others = {
    "own XML": mujoco.MjModel.from_xml_string(XML),
    "mj_saveModel": mujoco.MjModel.from_binary_path(f"{sys.argv[1]}/model.mjb"),
    "to_xml": mujoco.MjModel.from_xml_string(written),
    "mj_saveLastXML": mujoco.MjModel.from_xml_path(f"{sys.argv[1]}/last.xml"),
}
right, error = angles(model), {}
for name, other in others.items():
    apart = np.abs(angles(other) - right).max(axis=1)
    error[name] = [float(f"{apart[second * 500 - 1]:.1e}") for second in (2, 6, 8)]
print(f"mujoco {mujoco.__version__}: rad apart after 2, 6 and 8 s: {error}")
print(f"mass of the first pole {model.body_mass[1]:.9f}, by to_xml {others['to_xml'].body_mass[1]:.9f}")
assert "0.707107" in written and "0.7071067" not in written
assert error["own XML"] == error["mj_saveModel"] == [0, 0, 0]
assert all(0 < error[name][0] < 1e-3 and max(error[name]) > 0.02 for name in ("to_xml", "mj_saveLastXML"))
PYTHON

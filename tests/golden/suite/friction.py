"""Records friction.json: control steps of the reference's environments with a floor friction that is not the default.

Needs stable-worldmodel 0.1.1, dm_control 1.0.50 and mujoco 3.17.0. The start is the reference's own of seed 3, warm start of the
solver included. Frictions are above those of the agents' geoms: below, the reference's has no effect.
"""

import json
from pathlib import Path

import gymnasium
import numpy as np
import stable_worldmodel  # noqa: F401, registers the environments

STEPS = 40
cases = []
for env_id in ["swm/CheetahDMControl-v0", "swm/HumanoidDMControl-v0", "swm/WalkerDMControl-v0"]:
    friction = np.array([0.83], np.float32)
    env = gymnasium.make(env_id)
    env.reset(seed=3, options={"variation": [], "variation_values": {"floor.friction": friction}})
    data = env.unwrapped.env.physics.data
    start = {name: getattr(data, name).tolist() for name in ["qpos", "qvel", "qacc_warmstart"]}
    action = np.linspace(-0.5, 0.5, env.action_space.shape[0])
    for _ in range(STEPS):
        env.step(action)
    end = {name: getattr(data, name).tolist() for name in ["qpos", "qvel"]}
    case = {"env": env_id, "friction": float(friction[0]), "action": action.tolist(), "steps": STEPS}
    cases.append(case | {"start": start, "end": end})
Path(__file__).with_suffix(".json").write_text(json.dumps(cases))

#!/usr/bin/env bash
# Software:  robosuite 1.5.2 with mujoco 3.3.7: `GymWrapper.reset(seed=…)`.
# Expected:  equal seeds give equal episodes, as Gymnasium has it.
# Happens:   the seed goes to NumPy's global generator, from which robosuite 1.5 does not sample: objects and joints are placed by the
#            environment's own generator, which goes on. Each reset is another episode, and the program's random numbers are set.
# Who:       users who evaluate policies on fixed seeds of robosuite's tasks by `GymWrapper`.
# Seen:      positions of the cube of Lift after reset(seed=0), three times: all different; in new environments of
#            `make(…, seed=0)` equal; np.random.random() after it is the first number of np.random.seed(0)
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages robosuite==1.5.2 mujoco==3.3.7 gymnasium==1.4.0 h5py==3.16.0
"$python" -W ignore - 2>"$folder/log" <<'PYTHON' || { cat "$folder/log"; exit 1; }
import gymnasium
import numpy as np
import robosuite
from robosuite.wrappers import GymWrapper


def lift(**options):
    task = robosuite.make("Lift", robots="Panda", has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False, **options)
    return GymWrapper(task)


def start(env, seed):
    env.reset(seed=seed)
    task = env.unwrapped
    return task.sim.data.body_xpos[task.cube_body_id].round(4).tolist()


env = lift()
assert isinstance(env, gymnasium.Env)
starts = [start(env, 0) for _ in range(3)]
number = np.random.random()
made = [start(lift(seed=0), seed) for seed in (5, 6)]
print(f"robosuite {robosuite.__version__}, gymnasium {gymnasium.__version__}: positions of the cube after reset(seed=0): {starts}")
print(f"by new environments with make(seed=0), after reset(seed=5) and reset(seed=6): {made}")
assert len({tuple(one) for one in starts}) == 3 and made[0] == made[1]
assert number == np.random.RandomState(0).random()
PYTHON

#!/usr/bin/env bash
# Software:  dm_control 1.0.50 with mujoco 4.0.0, which its requirements allow.
# Expected:  `suite.load` makes the tasks of the Control Suite.
# Happens:   none of the 51 can be made: the binding names a field that MuJoCo 4 no longer has.
# Who:       users who compare the suite here with dm_control, or render its reference images.
# Seen:      0 of 51 tasks: AttributeError: 'MjModel' object has no attribute 'flex_vertedge'
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages mujoco==4.0.0 dm_control==1.0.50
MUJOCO_GL=disable "$python" - 2>/dev/null <<'PYTHON'
import mujoco
from dm_control import suite
from importlib.metadata import version

made, errors = 0, set()
for task in suite.ALL_TASKS:
    try:
        suite.load(*task)
        made += 1
    except AttributeError as error:
        errors.add(f"{type(error).__name__}: {error}")
print(f"dm_control {version('dm_control')}, mujoco {mujoco.__version__}: {made} of {len(suite.ALL_TASKS)} tasks: {'; '.join(errors)}")
assert made == 0 and len(errors) == 1 and "flex_vertedge" in errors.pop()
PYTHON

#!/usr/bin/env bash
# Software:  pyquaternion 0.9.9: `Quaternion.slerp` and `Quaternion.intermediates`.
# Expected:  interpolation returns a new quaternion and leaves its arguments alone.
# Happens:   where the two have opposite signs, the first argument is negated for good. (Its manual says that both are normalized.)
# Who:       users who resample recorded orientations: rows that were interpolated from have the other sign afterwards, which a network
#            that reads quaternions sees as a jump.
# Seen:      slerp from [0.996, 0, 0, 0.087] to [-0.906, 0, 0, -0.423]: the first is [-0.996, 0, 0, -0.087] afterwards
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pyquaternion==0.9.9 numpy==2.4.6
"$python" - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from pyquaternion import Quaternion


def turns(*degrees):
    return [Quaternion(axis=[0, 0, 1], degrees=angle) for angle in degrees]


def recorded():
    first, second = turns(10, 50)
    return first, -second


def values(quaternions):
    return np.array([one.q for one in quaternions])


before = values(recorded())
by_slerp, by_intermediates, copied = recorded(), recorded(), recorded()
middle = Quaternion.slerp(*by_slerp, 0.5)
list(Quaternion.intermediates(*by_intermediates, 2))
Quaternion.slerp(*map(Quaternion, copied), 0.5)
after = values(by_slerp)
print(f"pyquaternion {version('pyquaternion')}: before {before.round(3).tolist()}, after {after.round(3).tolist()}")
print(f"in the middle {middle.q.round(3).tolist()}; after intermediates {values(by_intermediates).round(3).tolist()}")
for found in (after, values(by_intermediates)):
    assert np.allclose(found[0], -before[0]) and np.allclose(found[1], before[1])
assert np.array_equal(values(copied), before)
PYTHON

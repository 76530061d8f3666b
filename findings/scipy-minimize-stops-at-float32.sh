#!/usr/bin/env bash
# Software:  scipy 1.17.1: `optimize.minimize` without `jac` on a cost that is computed in float32.
# Expected:  it finds the minimum, or reports that it cannot.
# Happens:   derivatives are differences over a step of 1.5e-8, which is below the resolution of float32: they are 0, and the start is
#            returned with `success=True`, also where the cost is returned as a float of Python. Powell and Nelder-Mead find the minimum.
# Who:       users who plan or fit by a model in float32 (JAX, torch, ONNX): the plan is the initial one.
# Seen:      minimum at [1, -2, 0.5], start at [0, 0, 0]: BFGS, L-BFGS-B, CG, SLSQP and TNC return [0, 0, 0] with success=True; in
#            float64 and with eps=1e-3 they find it (then BFGS and CG with success=False)
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages scipy==1.17.1 numpy==2.4.6
"$python" - <<'PYTHON'
import numpy as np
import scipy
from scipy.optimize import minimize

GOAL = np.array([1, -2, 0.5])
METHODS = ["BFGS", "L-BFGS-B", "CG", "SLSQP", "TNC"]


def found(method, dtype, **options):
    def cost(x):
        return float(((np.asarray(x, dtype) - GOAL.astype(dtype)) ** 2).sum() + 1)

    result = minimize(cost, np.zeros(3), method=method, options=options)
    return result.success, result.x.round(2).tolist()


single = {method: found(method, np.float32) for method in METHODS}
double = {method: found(method, np.float64) for method in METHODS}
larger = {method: found(method, np.float32, eps=1e-3) for method in METHODS}
others = {method: found(method, np.float32) for method in ("Powell", "Nelder-Mead")}
print(f"scipy {scipy.__version__}, success and minimum: float32 {single}")
print(f"float64 {double}; float32 with eps=1e-3 {larger}")
print(f"float32 without derivatives {others}")
assert all(one == (True, [0, 0, 0]) for one in single.values())
assert all(np.allclose(one[1], GOAL, atol=0.02) for runs in (double, larger, others) for one in runs.values())
PYTHON

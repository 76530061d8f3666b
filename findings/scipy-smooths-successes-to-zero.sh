#!/usr/bin/env bash
# Software:  scipy 1.18.1: `ndimage.gaussian_filter1d` and `uniform_filter1d` of integers and booleans.
# Expected:  smoothing 0 and 1 gives shares between them, as `numpy.convolve` and `signal.savgol_filter` do.
# Happens:   the result has the type of the input (its manual says so), and shares are cut off to 0, not rounded: wherever a window has one
#            failure the curve is 0. A frame of uint8 loses half a value per axis. No warning.
# Who:       users who smooth successes, rewards or lengths that are integers, as datasets and `evaluate` give them, or blur frames.
# Seen:      successes of which 80 % are 1: smoothed 0 throughout, of floats 0.8; mean of a frame 126.8, of
#            the blurred one 125.8 for uint8, 126.8 for float
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages scipy==1.18.1 numpy==2.5.5
"$python" -W error - <<'PYTHON'
import numpy as np
import scipy
from scipy import ndimage

success = np.tile([1, 1, 0, 1, 1], 20)
filters = {
    "gaussian_filter1d": lambda values: ndimage.gaussian_filter1d(values, 10),
    "uniform_filter1d": lambda values: ndimage.uniform_filter1d(values, 25),
}
found = {}
for name, smooth in filters.items():
    for dtype in (int, bool, float):
        values = smooth(success.astype(dtype))
        found[name, dtype.__name__] = (float(values.min()), float(values.max()))
frame = np.random.default_rng(0).integers(0, 256, (64, 64), dtype=np.uint8)
blurred = {dtype.__name__: round(float(ndimage.gaussian_filter(frame.astype(dtype), 1).mean()), 2) for dtype in (np.uint8, float)}
print(f"scipy {scipy.__version__}, least and greatest of smoothed successes of which 80 % are 1: {found}")
print(f"mean of a frame {frame.mean():.2f}, of the blurred one, by type: {blurred}")
for name in filters:
    assert found[name, "int"] == found[name, "bool"] == (0, 0) and np.allclose(found[name, "float"], 0.8, atol=0.03)
assert blurred["uint8"] < blurred["float"] - 0.4 and abs(blurred["float"] - frame.mean()) < 0.3
PYTHON

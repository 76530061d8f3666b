#!/usr/bin/env bash
# Software:  ml_dtypes 0.6.0 with NumPy 2.4.6: `sum`, `mean` and `std` of arrays of bfloat16.
# Expected:  sums in a wider type, as NumPy has for the mean of float16, and as JAX and torch have for bfloat16.
# Happens:   each addition is rounded to bfloat16, whose 8 bits cannot hold 257: the sum of ones stops at 256, along each axis.
# Who:       users who take statistics of latents or images in bfloat16, as JAX hands them to NumPy (`np.asarray`).
# Seen:      of 1000 ones: sum 256, mean 0.255859, std 0.503906; of float16 1000, 1, 0
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages ml_dtypes==0.6.0 numpy==2.4.6
"$python" - <<'PYTHON'
import ml_dtypes
import numpy as np


def statistics(values):
    return [float(value) for value in (values.sum(), values.mean(), values.std(), values.reshape(-1, 1).mean(axis=0)[0])]


ones = np.ones(1000, ml_dtypes.bfloat16)
found, half = statistics(ones), statistics(ones.astype(np.float16))
wide = float(ones.mean(dtype=np.float32))
print(f"ml_dtypes {ml_dtypes.__version__}, NumPy {np.__version__}: sum, mean, std, mean of a column of 1000 ones of bfloat16 {found}")
print(f"of float16 {half}; mean with dtype=np.float32 {wide}")
assert found[0] == 256 and abs(found[1] - 0.256) < 0.001 and found[2] > 0.4 and found[3] == found[1]
assert half == [1000, 1, 0, 1] and wide == 1
PYTHON

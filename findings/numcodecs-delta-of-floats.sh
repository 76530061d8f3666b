#!/usr/bin/env bash
# Software:  numcodecs 0.17.1: the filter `Delta` on floats, alone and in zarr 3.4.2 (numcodecs 0.16.6 with zarr 3.1.6 the same).
# Expected:  a filter before a lossless compressor gives the same values back.
# Happens:   decoding adds up differences in the array's own type. After one NaN, all later values of the chunk are NaN; after one large
#            value, small ones are lost; all others are rounded, more with each row. Integers are exact.
# Who:       users who compress joint positions or actions in a Zarr replay buffer, whose last row of an episode is NaN.
# Seen:      [0.1, 0.2, nan, 0.4, 0.5] is read as [0.1, 0.2, nan, nan, nan]; [1e8, 1, 2, 3] as [1e8, 0, 1, 2]; error 3e-5 of 100,000 values
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages numcodecs==0.17.1 zarr==3.4.2 numpy==2.5.5
"$python" -W ignore - "$folder/a.zarr" <<'PYTHON'
import sys

import numcodecs
import numpy as np
import zarr
from zarr.codecs.numcodecs import Delta

delta = numcodecs.Delta("f4")


def read_again(values, codec=delta):
    return codec.decode(codec.encode(values))


gap = np.array([0.1, 0.2, np.nan, 0.4, 0.5], "f4")
large = np.array([1e8, 1, 2, 3], "f4")
many = np.random.default_rng(0).normal(size=100_000).astype("f4")
integers = np.array([0, 255, 0, 10], "u1")
array = zarr.create_array(sys.argv[1], shape=(6,), chunks=(3,), dtype="f4", filters=[Delta(dtype="f4")])
array[:] = [np.nan, 0.2, 0.3, 0.4, 0.5, 0.6]
in_zarr = zarr.open_array(sys.argv[1])[:]
error = float(np.abs(read_again(many) - many).max())
print(f"numcodecs {numcodecs.__version__}: {gap} is read as {read_again(gap)}, {large} as {read_again(large)}, error {error:.1e}")
print(f"zarr {zarr.__version__}, two chunks, the first of which begins with NaN: {in_zarr}")
assert np.isnan(read_again(gap)[2:]).all() and read_again(large).tolist() == [1e8, 0, 1, 2] and error > 1e-5
assert np.isnan(in_zarr[:3]).all() and np.allclose(in_zarr[3:], [0.4, 0.5, 0.6])
assert np.array_equal(read_again(integers, numcodecs.Delta("u1")), integers)
PYTHON

#!/usr/bin/env bash
# Software:  h5py 3.16.0 with its HDF5 2.0, on x86-64: the scale-offset filter (`scaleoffset=`) on floats.
# Expected:  values are rounded to the given number of decimal digits, and NaN stays NaN, or writing it fails.
# Happens:   a NaN becomes the minimum of its chunk. Where the first value of a chunk of float32 is NaN, writing succeeds and no value
#            of the chunk can be read again; a chunk of float64 that begins so is stored as it is, with its NaN.
# Who:       users whose last row of an episode has no action (NaN), or whose sensors report missing values as NaN.
# Seen:      [-0.5, 0.25, 1, nan] is read as [-0.5, 0.25, 1, -0.5]; [nan, 0.25, 1, -0.5]: filter returned failure during read
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages h5py==3.16.0 numpy==2.4.6
"$python" - "$folder/a.h5" <<'PYTHON'
import sys

import h5py
import numpy as np

columns = {"none": [-0.5, 0.25, 1.0, 0.75], "last": [-0.5, 0.25, 1.0, np.nan], "first": [np.nan, 0.25, 1.0, -0.5]}
wide = np.array(columns["first"], "f8")
found = {}
with h5py.File(sys.argv[1], "w") as file:
    for name, values in columns.items():
        file.create_dataset(name, data=np.array(values, "f4"), chunks=(4,), scaleoffset=3)
    file.create_dataset("wide", data=wide, chunks=(4,), scaleoffset=3)
with h5py.File(sys.argv[1]) as file:
    for name in columns:
        try:
            found[name] = file[name][:].round(3).tolist()
        except OSError as error:
            found[name] = str(error)
    assert np.array_equal(file["wide"][:], wide, equal_nan=True)
print(f"h5py {h5py.__version__}, HDF5 {h5py.version.hdf5_version}: {found}")
assert found["none"] == columns["none"] and found["last"] == [-0.5, 0.25, 1.0, -0.5]
assert "filter returned failure during read" in found["first"]
PYTHON

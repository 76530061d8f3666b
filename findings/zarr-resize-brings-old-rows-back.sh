#!/usr/bin/env bash
# Software:  zarr 3.4.2 (Python 3.12 or later): `resize` to fewer rows and to more again, in both formats.
# Expected:  rows that were cut off are gone, and new rows have the fill value, as in HDF5.
# Happens:   `resize` removes whole chunks only. The rest of the last chunk keeps its values, which are rows again after the array
#            grows: in part the old ones, in part the fill value, by the size of chunks.
# Who:       users who cut an unfinished or failed episode off a replay buffer and allocate rows for the next one.
# Seen:      6 rows [1, 2, 3, 4, 5, 6] in chunks of 4, resized to 2 and 6: zarr [1, 2, 3, 4, 0, 0], h5py [1, 2, 0, 0, 0, 0]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages zarr==3.4.2 h5py==3.16.0 numpy==2.5.5
"$python" -W ignore - "$folder" <<'PYTHON'
import sys

import h5py
import numpy as np
import zarr

VALUES = np.arange(1.0, 7.0)


def cut_and_grow(rows, resize):
    rows[:] = VALUES
    resize((2,))
    assert rows[:].tolist() == [1, 2]
    resize((6,))
    return rows[:].tolist()


found = {}
for format in (2, 3):
    path = f"{sys.argv[1]}/{format}.zarr"
    rows = zarr.create_array(path, shape=(6,), chunks=(4,), dtype="f8", fill_value=0, zarr_format=format)
    found[f"zarr {zarr.__version__}, format {format}"] = cut_and_grow(rows, rows.resize)
    assert zarr.open_array(path, mode="r")[:].tolist() == rows[:].tolist()
with h5py.File(f"{sys.argv[1]}/a.h5", "w") as file:
    rows = file.create_dataset("a", shape=(6,), chunks=(4,), maxshape=(None,), dtype="f8", fillvalue=0)
    found[f"h5py {h5py.__version__}"] = cut_and_grow(rows, lambda shape: rows.resize(shape))
print(found)
assert list(found.values()) == [[1, 2, 3, 4, 0, 0]] * 2 + [[1, 2, 0, 0, 0, 0]]
PYTHON

#!/usr/bin/env bash
# Software:  h5py 3.16.0 (HDF5 2.0) with libver="latest", read by h5py 3.12.1 (HDF5 1.14.4).
# Expected:  datasets of numbers open in the HDF5 that most clusters have.
# Happens:   the file opens, plain and text datasets are read, and filtered and boolean ones cannot be opened.
# Who:       labs that write with a new h5py and train where HDF5 1.14 is; `swm` reads with 1.14, too.
# Seen:      compressed: KeyError (bad version number for layout message); flags: KeyError (bad version number for datatype message)
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages h5py==3.16.0
"$python" - "$folder/latest.h5" <<'PYTHON'
import sys

import h5py
import numpy as np

with h5py.File(sys.argv[1], "w", libver="latest") as file:
    file["plain"] = np.arange(10.0)
    file["flags"] = np.array([True, False])
    file.create_dataset("compressed", data=np.arange(100.0), chunks=(10,), compression="gzip")
print(f"written by h5py {h5py.__version__}, HDF5 {h5py.version.hdf5_version}")
PYTHON
packages h5py==3.12.1
"$python" - "$folder/latest.h5" <<'PYTHON'
import sys

import h5py

print(f"read by h5py {h5py.__version__}, HDF5 {h5py.version.hdf5_version}")
found = {}
with h5py.File(sys.argv[1]) as file:
    for name in file:
        try:
            found[name] = str(file[name][0])
        except KeyError as error:
            found[name] = f"KeyError: {error}"
        print(f"  {name}: {found[name]}")
assert found["plain"] == "0.0" and "layout message" in found["compressed"] and "datatype message" in found["flags"]
PYTHON

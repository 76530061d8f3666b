#!/usr/bin/env bash
# Software:  h5py 3.16.0 with NumPy 2.4.6: a conversion by the file, and by NumPy.
# Expected:  both give the same values for numbers that do not fit.
# Happens:   HDF5 clips to the range of the type (300 -> 255, 200 as int8 -> 127), NumPy wraps (300 -> 44, 200 -> -56); no error.
# Who:       users who write images of integers, or read a column as another type: the result depends on where it is converted.
# Seen:      written to uint8: [255, 0, 255], NumPy: [44, 255, 255]; read as int8: [127], NumPy: [-56]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages h5py==3.16.0 numpy==2.4.6
"$python" - "$folder/a.h5" <<'PYTHON'
import sys

import h5py
import numpy as np

values = np.array([300, -1, 255])
with h5py.File(sys.argv[1], "w") as file:
    pixels = file.create_dataset("pixels", (3,), "u1")
    pixels[...] = values
    written, by_numpy = pixels[...].tolist(), values.astype("u1").tolist()
    pixels[0] = 200
    read, cast = pixels.astype("i1")[:1].tolist(), pixels[:1].astype("i1").tolist()
print(f"h5py {h5py.__version__}: written to uint8 {written}, NumPy {by_numpy}; read as int8 {read}, NumPy {cast}")
assert (written, by_numpy, read, cast) == ([255, 0, 255], [44, 255, 255], [127], [-56])
PYTHON

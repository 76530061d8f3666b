#!/usr/bin/env bash
# Software:  h5py 3.16.0 with ml_dtypes 0.6.0 and NumPy 2.4.6.
# Expected:  an array of bfloat16 is refused, or read as it was written.
# Happens:   it is written as two opaque bytes a value, and read as |V2: the type is in the file no more.
# Who:       users who store latents or images of models in bfloat16; a float8 becomes |V1.
# Seen:      bfloat16 [1 2.5] is read as |V2
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages h5py==3.16.0 ml_dtypes==0.6.0 numpy==2.4.6
"$python" - "$folder/a.h5" <<'PYTHON'
import sys

import h5py
import ml_dtypes
import numpy as np

latents = np.array([1, 2.5], ml_dtypes.bfloat16)
with h5py.File(sys.argv[1], "w") as file:
    file["latents"] = latents
with h5py.File(sys.argv[1]) as file:
    found = file["latents"][...]
print(f"h5py {h5py.__version__}, NumPy {np.__version__}: {latents.dtype} {latents} is read as {found.dtype.str}: {found}")
assert found.dtype.str == "|V2" and (found.view(ml_dtypes.bfloat16) == latents).all()
PYTHON

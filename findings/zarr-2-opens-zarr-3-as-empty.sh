#!/usr/bin/env bash
# Software:  zarr 2.18.7 on a store that zarr 3.1.6 wrote in its own format (Python 3.11 or later).
# Expected:  an error: the format is another one.
# Happens:   `zarr.open(path)` gives an empty group, and writes a `.zgroup` into the store: from then on `mode="r"` gives an
#            empty group, too.
# Who:       labs whose older code (diffusion policies, robomimic-like stores) reads stores of a newer zarr before `swm` or h5py
#            gets them.
# Seen:      keys []; files ['.zgroup', 'action', 'zarr.json']
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages zarr==3.1.6
"$python" - "$folder/data.zarr" <<'PYTHON'
import sys

import numpy as np
import zarr

zarr.open_group(sys.argv[1], mode="w").create_array("action", data=np.arange(6.0))
print(f"zarr {zarr.__version__} wrote {list(zarr.open_group(sys.argv[1], mode='r'))}")
PYTHON
packages zarr==2.18.7
"$python" - "$folder/data.zarr" <<'PYTHON'
import os
import sys

import zarr

first = list(zarr.open(sys.argv[1]))
files = sorted(os.listdir(sys.argv[1]))
print(f"zarr {zarr.__version__}: keys {first}; files {files}; read-only, keys {list(zarr.open(sys.argv[1], mode='r'))}")
assert first == [] and ".zgroup" in files
PYTHON

#!/usr/bin/env bash
# Software:  zarr 3.1.6: `append` to an array of a group with consolidated metadata, in both formats.
# Expected:  three appends of two rows to two rows give eight rows.
# Happens:   `group["action"]` takes its shape from the consolidated metadata, which `append` does not update: each append begins
#            at the old end and replaces the rows of the one before, and a reader sees none of them. No error, no warning.
# Who:       users who add episodes to a store of others, as these are often consolidated for reading by network.
# Seen:      rows a reader gets [0.0, 0.0]; rows of the store [0.0, 0.0, 3.0, 3.0]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages zarr==3.1.6 numpy==2.4.6
"$python" -W ignore - "$folder" <<'PYTHON'
import sys

import numpy as np
import zarr


def rows(format, consolidated):
    path = f"{sys.argv[1]}/{format}-{consolidated}.zarr"
    zarr.open_group(path, mode="w", zarr_format=format).create_array("action", data=np.zeros(2), chunks=(2,))
    if consolidated:
        zarr.consolidate_metadata(path)
    group = zarr.open_group(path, mode="a")
    for value in (1.0, 2.0, 3.0):
        group["action"].append(np.full(2, value))
    reader = zarr.open_group(path, mode="r")["action"][:].tolist()
    return reader, zarr.open_group(path, mode="r", use_consolidated=False)["action"][:].tolist()


for format in (2, 3):
    found = {consolidated: rows(format, consolidated) for consolidated in (False, True)}
    print(f"zarr {zarr.__version__}, format {format}: reader and store, by consolidated: {found}")
    assert found[False] == ([0, 0, 1, 1, 2, 2, 3, 3],) * 2
    assert found[True] == ([0, 0], [0, 0, 3, 3])
PYTHON

#!/usr/bin/env bash
# Software:  pyarrow 26.0.1: `values` and `flatten()` of a column of vectors, as LeRobot's tables have them.
# Expected:  the values of the rows that the array has.
# Happens:   after `slice` (or on a chunk of a sliced table), `.values` has those of all rows, so that row 0 is another episode's;
#            `flatten()` leaves null rows out, so that all later rows move up by one.
# Who:       users who cut episodes out of Parquet tables by hand and reshape `.values` to (rows, dim).
# Seen:      rows 2 and 3: values begin with 0.0, flatten with 4.0; a null row: 4 values of 3 rows of 2
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pyarrow==26.0.1 numpy==2.4.6
"$python" - <<'PYTHON'
import numpy as np
import pyarrow as pa

state = pa.FixedSizeListArray.from_arrays(pa.array(np.arange(8.0)), 2)
episode = pa.table({"state": state}).slice(2, 2)["state"].chunk(0)
values, flat = episode.values.to_numpy().reshape(-1, 2), episode.flatten().to_numpy().reshape(-1, 2)
missing = pa.array([[1.0, 2.0], None, [3.0, 4.0]], pa.list_(pa.float64(), 2))
print(f"pyarrow {pa.__version__}: rows 2 and 3: {episode.to_pylist()}; values {values.tolist()}; flatten {flat.tolist()}")
print(f"a null row: {missing.flatten().to_pylist()} of {len(missing)} rows")
assert values[0].tolist() == [0, 1] and flat.tolist() == [[4, 5], [6, 7]]
assert missing.flatten().to_pylist() == [1, 2, 3, 4]
PYTHON

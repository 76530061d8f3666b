#!/usr/bin/env bash
# Software:  datasets 5.2.0 (Hugging Face): `with_format("numpy")`.
# Expected:  a column of float64 is read as float64, or as one type, however it is read.
# Happens:   `ds["t"][:]`, `ds[:]` and `iter(batch_size=…)` give float32, and `ds[0]` gives float64: times in seconds since 1970 are
#            rounded to multiples of 128, so that steps of 20 ms are all at the same time.
# Who:       users who read tables of robots with absolute times (ROS, MCAP), or positions that need float64.
# Seen:      column [1700000000.0, 1700000000.0], rows [1700000000.02, 1700000000.04]; with dtype=np.float64 the column, too
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages datasets==5.2.0 numpy==2.4.6
"$python" - <<'PYTHON'
import datasets
import numpy as np

times = [1700000000.02, 1700000000.04]
table = datasets.Dataset.from_dict({"t": np.array(times)})
read = table.with_format("numpy")
column, batch = read["t"][:], next(read.iter(batch_size=2))["t"]
rows = [float(read[i]["t"]) for i in range(2)]
named = table.with_format("numpy", dtype=np.float64)["t"][:].tolist()
print(f"datasets {datasets.__version__}: column {column.tolist()}, rows {rows}, with dtype {named}")
assert table.features["t"].dtype == "float64" and rows == named == times
assert column.dtype == np.float32 and column.tolist() == batch.tolist() == read[:]["t"].tolist() == [1700000000.0, 1700000000.0]
PYTHON

#!/usr/bin/env bash
# Software:  pyarrow 26.0.1: reading Parquet with a filter (`pq.read_table(filters=…)`, `dataset.to_table(filter=…)`).
# Expected:  the same rows as those of the filter on the table in memory.
# Happens:   statistics of a row group have no NaN, and row groups are left out by them: `is_nan` finds nothing where all other
#            values of the row group are equal, and `x != 1` and `~(x < 5)` lose NaN rows. No error.
# Who:       users who look for NaN in rewards or actions of tables (LeRobot's, for example), or who select rows by a negation.
# Seen:      is_nan: file [], memory [nan]; ~(x < 5): file [], memory [nan]; x != 1: file [2.0, 3.0], memory [nan, 2.0, 3.0]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pyarrow==26.0.1
"$python" - "$folder/a.parquet" <<'PYTHON'
import sys

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.parquet as pq

table = pa.table({"reward": [1.0, float("nan"), 2.0, 3.0]})
pq.write_table(table, sys.argv[1], row_group_size=2)
reward = pc.field("reward")
filters = {"is_nan": pc.is_nan(reward), "~(x < 5)": ~(reward < 5), "x != 1": reward != 1.0}
found = {}
for name, chosen in filters.items():
    read = pq.read_table(sys.argv[1], filters=chosen)["reward"].to_pylist()
    assert str(read) == str(ds.dataset(sys.argv[1]).to_table(filter=chosen)["reward"].to_pylist())
    found[name] = (str(read), str(table.filter(chosen)["reward"].to_pylist()))
print(f"pyarrow {pa.__version__}: rows of the file and of the table in memory: {found}")
assert found == {
    "is_nan": ("[]", "[nan]"),
    "~(x < 5)": ("[]", "[nan]"),
    "x != 1": ("[2.0, 3.0]", "[nan, 2.0, 3.0]"),
}
PYTHON

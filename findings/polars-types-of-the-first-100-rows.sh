#!/usr/bin/env bash
# Software:  polars 2.1.0: `DataFrame` and `from_dicts` of a list of rows (dicts), `read_ndjson`.
# Expected:  the values of all rows, or an error.
# Happens:   columns and types are those of the first 100 rows (`infer_schema_length`). A key that comes later is left out without a
#            word; in a list of rows, a number with a fraction after 100 integers is cut to an integer, with `strict=True`, too (a file
#            of such lines is an error).
# Who:       users who make tables of logs or infos: a success that the last step alone has, an evaluation that begins after 100 epochs.
# Seen:      101 rows, the last with distance 0.7 and success: DataFrame has the distance 0 and no success; with
#            `infer_schema_length=None` 0.7 and True
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages polars==2.1.0
"$python" - "$folder/log.jsonl" <<'PYTHON'
import json
import sys

import polars as pl

rows = [{"step": step, "distance": 0} for step in range(100)] + [{"step": 100, "distance": 0.7, "success": True}]
last = {}
for make in (pl.DataFrame, pl.from_dicts):
    last[make.__name__] = make(rows, strict=True).row(-1, named=True)
    last[make.__name__ + ", all rows"] = make(rows, infer_schema_length=None).row(-1, named=True)
with open(sys.argv[1], "w") as file:
    file.writelines(json.dumps({name: value for name, value in row.items() if name != "distance"}) + "\n" for row in rows)
last["read_ndjson"] = pl.read_ndjson(sys.argv[1]).row(-1, named=True)
last["read_ndjson, all rows"] = pl.read_ndjson(sys.argv[1], infer_schema_length=None).row(-1, named=True)
print(f"polars {pl.__version__}, the last row of {len(rows)}, which is {rows[-1]}:")
for name, row in last.items():
    print(f"{name}: {row}")
assert last["DataFrame"] == last["from_dicts"] == {"step": 100, "distance": 0}
assert last["DataFrame, all rows"] == last["from_dicts, all rows"] == rows[-1]
assert last["read_ndjson"] == {"step": 100} and last["read_ndjson, all rows"] == {"step": 100, "success": True}
PYTHON

#!/usr/bin/env bash
# Software:  pyarrow 26.0.1 (and pandas 3.1.1): a folder of Parquet files, one per episode.
# Expected:  all columns, with nulls where a file has none, or an error that the files differ.
# Happens:   the schema is that of the file whose name sorts first: columns of later files are left out, without an error or a warning,
#            and whole floats of later files become the integers of the first.
# Who:       users whose recorder gained a column (`success`, a reward, a camera's time) after the first episodes.
# Seen:      first file without `success`: columns ['step'] of 4 rows; with the files' names exchanged: ['step', 'success']
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pyarrow==26.0.1 pandas==3.1.1 numpy==2.4.6
"$python" - "$folder" <<'PYTHON'
import os
import sys

import pandas as pd
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq

old = pa.table({"step": [0, 1]})
new = pa.table({"step": [0.0, 1.0], "success": [False, True]})
found = {}
for name, tables in {"old first": (old, new), "new first": (new, old)}.items():
    path = os.path.join(sys.argv[1], name)
    os.mkdir(path)
    for episode, table in enumerate(tables):
        pq.write_table(table, f"{path}/episode_{episode:06}.parquet")
    read = pq.read_table(path)
    assert ds.dataset(path).to_table() == read and list(pd.read_parquet(path).columns) == read.column_names
    found[name] = {field.name: str(field.type) for field in read.schema}, read.num_rows
    schema = pa.unify_schemas([part.physical_schema for part in ds.dataset(path).get_fragments()], promote_options="permissive")
    whole = ds.dataset(path, schema=schema).to_table()
    assert sorted(whole["success"].to_pylist(), key=str) == [False, None, None, True]
print(f"pyarrow {pa.__version__}, pandas {pd.__version__}: {found}")
assert found["old first"] == ({"step": "int64"}, 4)
assert found["new first"] == ({"step": "double", "success": "bool"}, 4)
PYTHON

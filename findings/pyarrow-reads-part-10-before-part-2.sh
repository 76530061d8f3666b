#!/usr/bin/env bash
# Software:  pyarrow 26.0.1: `write_dataset(…, max_rows_per_file=…)`, read again by pyarrow, pandas 3.1.1, polars 2.1.0 and duckdb 2.0.1.
# Expected:  rows come back in the order in which they were written.
# Happens:   the writer names its files part-0, part-1, …, and all four read them in the order of their names: part-10 and part-11 come
#            before part-2. With up to 10 files the order is right. (The notes of pyarrow promise no order of files that it discovers.)
# Who:       users who write frames in files of a limited size and read them back by row number, or cut episodes by start and length.
# Seen:      12 files of 100 rows: files 0, 1, 10, 11, 2 to 9 for all four readers
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pyarrow==26.0.1 pandas==3.1.1 polars==2.1.0 duckdb==2.0.1 numpy==2.4.6
"$python" - "$folder" <<'PYTHON'
import sys

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.dataset as ds


def orders(files):
    folder = f"{sys.argv[1]}/{files}"
    frames = pa.table({"frame": np.arange(100 * files)})
    ds.write_dataset(frames, folder, format="parquet", max_rows_per_file=100, max_rows_per_group=100)
    read = {
        "pyarrow": ds.dataset(folder).to_table()["frame"].to_numpy(),
        "pandas": pd.read_parquet(folder)["frame"].to_numpy(),
        "polars": pl.read_parquet(folder)["frame"].to_numpy(),
        "duckdb": duckdb.sql(f"select frame from '{folder}/*.parquet'").fetchnumpy()["frame"],
        "listed": ds.dataset([f"{folder}/part-{i}.parquet" for i in range(files)]).to_table()["frame"].to_numpy(),
    }
    return {name: (frame[::100] // 100).tolist() for name, frame in read.items()}


ten, twelve = orders(10), orders(12)
listed = twelve.pop("listed")
print(f"pyarrow {pa.__version__}: order of 10 files {ten}")
print(f"order of 12 files {twelve}; given as a list {listed}")
assert all(order == list(range(10)) for order in ten.values())
assert listed == list(range(12))
assert all(order == [0, 1, 10, 11, *range(2, 10)] for order in twelve.values())
PYTHON

#!/usr/bin/env bash
# Software:  duckdb 2.0.1: `read_json` of a file of JSON lines, without options.
# Expected:  the values of all lines, or an error (which a key that comes late is).
# Happens:   types are those of the first 20,480 lines (`sample_size`). Where a column has integers there, numbers with a fraction that
#            come later are rounded to integers, without a word: a success rate of 0.4 becomes 0, one of 0.7 becomes 1.
# Who:       users who query metrics of a long training that begin with zeros: success rates, rewards, distances.
# Seen:      20,482 lines, the last two with 0.4 and 0.7: 0 and 1; with sample_size=-1 0.4 and 0.7
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages duckdb==2.0.1
"$python" - "$folder/metrics.jsonl" <<'PYTHON'
import json
import sys

import duckdb

path = sys.argv[1]


def last(zeros, options=""):
    with open(path, "w") as file:
        for step, success in enumerate([0] * zeros + [0.4, 0.7]):
            file.write(json.dumps({"step": step, "success": success}) + "\n")
    rows = duckdb.sql(f"select success from read_json('{path}'{options}) where step >= {zeros} order by step").fetchall()
    return [value for (value,) in rows]


short, long, whole = last(20470), last(20480), last(20480, ", sample_size=-1")
print(f"duckdb {duckdb.__version__}: 0.4 and 0.7 after 20470 zeros {short}, after 20480 {long}, with sample_size=-1 {whole}")
assert short == [0.4, 0.7] == whole and long == [0, 1]
PYTHON

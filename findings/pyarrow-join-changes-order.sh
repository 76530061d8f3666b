#!/usr/bin/env bash
# Software:  pyarrow 26.0.1: `Table.join`.
# Expected:  a left outer join keeps the rows of the left table in their order, as pandas does.
# Happens:   rows without a partner are moved to the end, also with `use_threads=False`; large tables can come back in blocks whose order
#            changes from run to run.
# Who:       users who join tasks or labels of episodes to the frames of a table, and go on by row number or save the table.
# Seen:      episodes [0, 0, 1, 1, 2, 2], of which 0 and 2 have a task: [0, 0, 2, 2, 1, 1]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pyarrow==26.0.1 numpy==2.4.6
"$python" - <<'PYTHON'
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

frames = pa.table({"episode": [0, 0, 1, 1, 2, 2], "frame": [0, 1, 0, 1, 0, 1]})
tasks = pa.table({"episode": [0, 2], "task": ["push", "pull"]})
threads, single = (frames.join(tasks, "episode", use_threads=use)["episode"].to_pylist() for use in (True, False))
looked_up = tasks["task"].take(pc.index_in(frames["episode"], value_set=tasks["episode"])).to_pylist()

long = pa.table({"episode": np.repeat(np.arange(5000), 100), "row": np.arange(500_000)})
labels = pa.table({"episode": np.arange(5000), "label": np.arange(5000) % 7})
breaks = [int((np.diff(long.join(labels, "episode")["row"].to_numpy()) != 1).sum()) for _ in range(3)]

print(f"pyarrow {pa.__version__}: left {frames['episode'].to_pylist()}, joined {threads}, by one thread {single}")
print(f"looked up in order: {looked_up}; breaks in the order of 500,000 rows, each with a label, in three runs: {breaks}")
assert threads == single == [0, 0, 2, 2, 1, 1] and looked_up == ["push", "push", None, None, "pull", "pull"]
PYTHON

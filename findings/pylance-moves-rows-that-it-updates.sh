#!/usr/bin/env bash
# Software:  pylance 14.0.2: `LanceDataset.update` (and `Table.update` of lancedb 0.40.0, which writes such tables).
# Expected:  values change, and each row stays where it is.
# Happens:   rows that match are deleted and written anew behind all others: row i is another one from then on, in `to_table`, `take` and
#            scans, also with stable row ids and after `compact_files`. (The manual says so of `merge_insert`; of `update`,
#            lancedb's shows a row that has moved in an example.)
# Who:       users who correct a label or relabel rewards of an episode, and cut episodes out by row: the lengths of the episodes still add
#            up, and all episodes behind the corrected one are another's rows.
# Seen:      reward set for episode 1 of 0, 1, 2 with 4 steps each: the episodes are in the order 0, 2, 1, and `take` of rows 4 to 7 gives
#            episode 2; of one frame of it: the frame is the last row of all
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pylance==14.0.2 lancedb==0.40.0 numpy==2.4.6
"$python" - "$folder" <<'PYTHON' 2>"$folder/log"
import sys

import lance
import lancedb
import numpy as np
import pyarrow as pa

FRAMES = pa.table({"episode": np.arange(12) // 4, "step": np.arange(12) % 4, "reward": np.zeros(12)})


def frames(table):
    return list(zip(table["episode"].to_pylist(), table["step"].to_pylist()))


def updated(name, where, **options):
    dataset = lance.write_dataset(FRAMES, f"{sys.argv[1]}/{name}.lance", **options)
    count = dataset.update({"reward": "1.0"}, where=where)["num_rows_updated"]
    return count, lance.dataset(f"{sys.argv[1]}/{name}.lance")


before = frames(FRAMES)
count, whole = updated("whole", "episode = 1")
after = frames(whole.to_table())
taken = frames(whole.take([4, 5, 6, 7]))
whole.optimize.compact_files()
compacted = frames(lance.dataset(whole.uri).to_table())
stable = frames(updated("stable", "episode = 1", enable_stable_row_ids=True)[1].to_table())
single = frames(updated("single", "episode = 1 and step = 0")[1].to_table())
table = lancedb.connect(f"{sys.argv[1]}/db").create_table("frames", FRAMES)
table.update(where="episode = 1", values={"reward": 1.0})
through_lancedb = frames(table.to_arrow())
rows = [episode for episode, _ in after]
print(f"pylance {lance.__version__}, {count} rows updated; episodes by row: {rows}, rows 4 to 7: {taken}")
print(f"after the update of one frame, by row: {single}")
same = stable == after, compacted == after, through_lancedb == after
print(f"with stable row ids, compacted, by lancedb {lancedb.__version__}, the same order: {same}")
assert count == 4 and after == before[:4] + before[8:] + before[4:8] and taken == before[8:]
assert all(same) and single == before[:4] + before[5:] + [before[4]]
PYTHON

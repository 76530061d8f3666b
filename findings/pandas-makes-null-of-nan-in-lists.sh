#!/usr/bin/env bash
# Software:  pandas 3.1.1 with pyarrow 26.0.1: a table of LeRobot, or any with vectors, written by `to_parquet`.
# Expected:  a NaN within a vector stays a NaN.
# Happens:   it becomes null, within vectors, too. Readers that know no null in vectors refuse the table or shift values.
# Who:       users who edit tables of datasets by pandas. `swm` reads such a null as NaN.
# Seen:      reward [None, 1.0], action [[None, 1.0], [2.0, 3.0]]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pandas==3.1.1 pyarrow==26.0.1 numpy==2.4.6
"$python" - "$folder/a.parquet" <<'PYTHON'
import sys

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

actions = [np.array([np.nan, 1], np.float32), np.array([2, 3], np.float32)]
pd.DataFrame({"reward": np.array([np.nan, 1], np.float32), "action": actions}).to_parquet(sys.argv[1])
table = pq.read_table(sys.argv[1])
print(f"pandas {pd.__version__}: reward {table['reward'].to_pylist()}, action {table['action'].to_pylist()}")
assert table["reward"].null_count == 1 and table["action"].to_pylist()[0][0] is None
PYTHON

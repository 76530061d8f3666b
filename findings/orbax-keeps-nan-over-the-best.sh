#!/usr/bin/env bash
# Software:  orbax-checkpoint 0.12.8: `CheckpointManager` with `best_fn` and `max_to_keep`.
# Expected:  the best checkpoints stay; one whose metric is NaN counts as the worst, or saving it fails.
# Happens:   checkpoints are sorted by a metric that does not compare with NaN: one NaN parts the list, and what is removed depends on
#            the order of saving. The best checkpoint is deleted, without a warning, and `best_step` names another one, or that of NaN.
# Who:       users who keep the best checkpoints by return or loss, where one evaluation gives NaN.
# Seen:      two of returns 5, nan, 1, 2, 3 kept: 2 and 3; one of 9, nan: nan; two of losses 0.1, nan, 0.5, 0.3, 0.2: 0.3 and 0.2
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages orbax-checkpoint==0.12.8 jax==0.12.0.1
"$python" -W ignore - "$folder" 2>"$folder/log" <<'PYTHON' || { cat "$folder/log"; exit 1; }
import sys
import tempfile
from importlib.metadata import version

import numpy as np
import orbax.checkpoint as ocp

NAN = float("nan")


def kept(metrics, most, mode="max"):
    options = ocp.CheckpointManagerOptions(max_to_keep=most, best_fn=lambda metrics: metrics["return"], best_mode=mode)
    with ocp.CheckpointManager(tempfile.mkdtemp(dir=sys.argv[1]), options=options) as manager:
        for step, metric in enumerate(metrics):
            manager.save(step, args=ocp.args.StandardSave({"w": np.zeros(2)}), metrics={"return": metric})
            manager.wait_until_finished()
        return [metrics[step] for step in manager.all_steps()], metrics[manager.best_step()]


whole, split, last = kept([5.0, 0.0, 1.0, 2.0, 3.0], 2), kept([5.0, NAN, 1.0, 2.0, 3.0], 2), kept([9.0, NAN], 1)
loss = kept([0.1, NAN, 0.5, 0.3, 0.2], 2, "min")
print(f"orbax-checkpoint {version('orbax-checkpoint')}, kept and best: of 5, 0, 1, 2, 3 {whole}")
print(f"of 5, nan, 1, 2, 3 {split}; one of 9, nan {last}; of losses 0.1, nan, 0.5, 0.3, 0.2 {loss}")
assert whole == ([5, 3], 5) and split == ([2, 3], 3) and loss == ([0.3, 0.2], 0.2) and np.isnan(last[0] + [last[1]]).all()
PYTHON

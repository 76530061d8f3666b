#!/usr/bin/env bash
# Software:  lerobot 0.6.1 (Python 3.12 or later).
# Expected:  statistics that leave a missing value out, or say so; JSON that other programs read.
# Happens:   one NaN in a column makes min, max, mean, std and quantiles of the whole dataset NaN, and meta/stats.json
#            contains the word NaN, which JSON does not have.
# Who:       users whose last row has no action; those who normalize by stats.json get NaN everywhere.
# Seen:      action: mean [nan, nan], std [nan, nan]; a strict reader: not JSON: NaN
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages 'lerobot[dataset]==0.6.1'
HF_HUB_OFFLINE=1 "$python" - "$folder/data" 2>/dev/null <<'PYTHON'
import json
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

features = {name: {"dtype": "float32", "shape": (2,), "names": None} for name in ("action", "observation.state")}
data = LeRobotDataset.create("own/data", fps=10, root=sys.argv[1], features=features, use_videos=False)
for step in range(5):
    action = np.full(2, np.nan if step == 4 else step, np.float32)
    data.add_frame({"action": action, "observation.state": np.full(2, step, np.float32), "task": "none"})
data.save_episode()
data.finalize()
text = Path(sys.argv[1], "meta/stats.json").read_text()
action = json.loads(text)["action"]
print(f"lerobot {version('lerobot')}: action: mean {action['mean']}, std {action['std']}, count {action['count']}")
assert np.isnan(action["mean"]).all() and np.isnan(action["std"]).all()


def refuse(word):
    raise ValueError(f"not JSON: {word}")


try:
    json.loads(text, parse_constant=refuse)
    raise SystemExit("strict JSON: changed")
except ValueError as error:
    print("a strict reader:", error)
PYTHON

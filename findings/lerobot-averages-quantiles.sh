#!/usr/bin/env bash
# Software:  lerobot 0.6.1 (Python 3.12 or later): the quantiles q01 to q99 of `meta/stats.json`.
# Expected:  q01 and q99 are quantiles of all rows, or at least a bound for most of them.
# Happens:   `aggregate_stats`, which each saved episode and each merge of datasets calls, takes the mean of the episodes' quantiles.
#            Where episodes differ in range, most rows lie outside q01 to q99; min, max, mean and std are right.
# Who:       users of policies that normalize by quantiles (pi0.5 does), and of datasets with several tasks, goals or starts.
# Seen:      10 episodes, episode i within i to i + 1: q01 4.51, q99 5.49 in place of 0.10 and 9.90; normalized values from -10.1 to 10.2
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages --no-deps lerobot==0.6.1 numpy==2.2.6
"$python" - <<'PYTHON'
import importlib.util
import sys
import types
from importlib.metadata import version
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np

# The module of statistics needs NumPy only: what it imports for images and relative actions, and torch, stays out.
package = types.ModuleType("lerobot.datasets")
package.__path__ = [str(Path(importlib.util.find_spec("lerobot").origin).with_name("datasets"))]
sys.modules["lerobot.datasets"] = package
for name in ("lerobot.datasets.io_utils", "lerobot.processor", "lerobot.utils", "lerobot.utils.constants"):
    sys.modules[name] = MagicMock()
from lerobot.datasets.compute_stats import aggregate_stats, compute_episode_stats

features = {"action": {"dtype": "float32", "shape": (1,)}}
episodes = [np.linspace(start, start + 1, 200)[:, None] for start in range(10)]
rows = np.concatenate(episodes)
one = compute_episode_stats({"action": rows}, features)["action"]
stats = None
for episode in episodes:  # as datasets do when an episode is saved
    new = compute_episode_stats({"action": episode}, features)
    stats = new if stats is None else aggregate_stats([stats, new])
stats = stats["action"]
low, high = stats["q01"], stats["q99"]
normalized = 2 * (rows - low) / (high - low) - 1
inside = float(((rows >= low) & (rows <= high)).mean())
values = {name: [round(float(which[name][0]), 2) for which in (stats, one)] for name in ("min", "q01", "q99", "max", "mean", "std")}
print(f"lerobot {version('lerobot')}: by episodes and at once: {values}; rows within q01 to q99: {inside:.0%}, "
      f"normalized {normalized.min():.1f} to {normalized.max():.1f}")
assert np.allclose(values["mean"][0], values["mean"][1]) and np.allclose(values["std"][0], values["std"][1], atol=0.02)
assert values["q01"][1] < 0.2 and values["q99"][1] > 9.8 and low[0] > 4 and high[0] < 6 and inside < 0.15
PYTHON

#!/usr/bin/env bash
# Software:  torchrl 0.14.1 with tensordict 0.14.3: `ReplayBuffer.extend` on `LazyTensorStorage` and `LazyMemmapStorage`.
# Expected:  an error where data lack a key that the storage has, or a value that marks it as missing.
# Happens:   without an error, the key keeps what the memory has: new transitions get the values of those that they replace in the
#            ring, or whatever bytes there are before it is full. A key that only later data have is left out by LazyMemmapStorage.
# Who:       users who put demonstrations with labels (success, returns, tasks) and transitions of the policy without them into one buffer.
# Seen:      4 demonstrations with success 1, replaced by 4 transitions without it: rewards [7.0, 7.0, 7.0, 7.0], success [1.0, 1.0, 1.0, 1.0]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torchrl==0.14.1 tensordict==0.14.3 torch==2.15.0 numpy==2.4.6
RL_LOGGING_LEVEL=ERROR "$python" -W ignore - <<'PYTHON'
from importlib.metadata import version

import torch
from tensordict import TensorDict
from torchrl.data import LazyMemmapStorage, LazyTensorStorage, ReplayBuffer

demonstrations = TensorDict({"reward": torch.zeros(4), "success": torch.ones(4)}, [4])
own = TensorDict({"reward": torch.full((4,), 7.0)}, [4])
found = {}
for storage in (LazyTensorStorage, LazyMemmapStorage):
    buffer = ReplayBuffer(storage=storage(4), batch_size=4)
    buffer.extend(demonstrations)
    buffer.extend(own)
    later = ReplayBuffer(storage=storage(8), batch_size=4)
    later.extend(own)
    later.extend(demonstrations)
    rows = buffer[:]
    found[storage.__name__] = rows["reward"].tolist(), rows["success"].tolist(), "success" in later[:].keys()
try:
    torch.stack([demonstrations[0], own[0]])
    stacked = "stacks both"
except RuntimeError:
    stacked = "refuses to stack them"

print(f"torchrl {version('torchrl')}, tensordict {version('tensordict')}, which {stacked}:")
for name, (reward, success, kept) in found.items():
    print(f"{name}: rewards {reward}, success {success}; a key of later data is {'kept' if kept else 'left out'}")
assert all((reward, success) == ([7] * 4, [1] * 4) for reward, success, _ in found.values())
assert not found["LazyMemmapStorage"][2] and stacked.startswith("refuses")
PYTHON

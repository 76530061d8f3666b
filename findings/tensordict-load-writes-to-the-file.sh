#!/usr/bin/env bash
# Software:  tensordict 0.14.3 with torch 2.15.0: `TensorDict.save` and `TensorDict.load`.
# Expected:  what is loaded is a copy, as from `torch.load`, whose changes stay in memory.
# Happens:   what is loaded is the files, mapped for writing: operations in place (`data["obs"] -= mean`, `div_`, `update_`) change the
#            dataset on disk, without a call that saves. A second run of the same script normalizes normalized values.
# Who:       users who save datasets or rollouts as tensordicts and normalize, clip or label them after loading.
# Seen:      [0, 1, 2, 3] less its mean and divided by its std after loading: on disk [-1.16, -0.39, 0.39, 1.16]; labels that
#            are set are on disk, too; by `load(…).clone()` and by torch.load [0, 1, 2, 3]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages tensordict==0.14.3 torch==2.15.0 numpy==2.4.6
"$python" -W ignore - "$folder" <<'PYTHON'
import sys

import tensordict
import torch
from tensordict import TensorDict

mapped, cloned, plain = (f"{sys.argv[1]}/{name}" for name in ("mapped", "cloned", "plain.pt"))
values = {"obs": torch.arange(4.0), "success": torch.zeros(4)}
for path in (mapped, cloned):
    TensorDict(values, batch_size=[4]).save(path)
torch.save(values, plain)


def normalize(data):
    data["obs"] -= data["obs"].mean()
    data["obs"].div_(data["obs"].std())
    data["success"][-1] = 1


def rounded(data):
    return [round(value, 2) for value in data["obs"].tolist()] + data["success"].tolist()


normalize(TensorDict.load(mapped))
normalize(TensorDict.load(cloned).clone())
normalize(torch.load(plain))
normalize(torch.load(plain, mmap=True))
found = [rounded(TensorDict.load(mapped)), rounded(TensorDict.load(cloned)), rounded(torch.load(plain))]
print(f"tensordict {tensordict.__version__}: on disk, after normalizing what was loaded: {found[0]}; a clone of it: {found[1]}")
print(f"torch {torch.__version__}: the file of torch.save after the same, with mmap=True, too: {found[2]}")
assert found[0] == [-1.16, -0.39, 0.39, 1.16, 0, 0, 0, 1] and found[1] == found[2] == [0, 1, 2, 3, 0, 0, 0, 0]
PYTHON

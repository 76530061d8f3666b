#!/usr/bin/env bash
# Software:  torch 2.15.0 with NumPy: a dataset that keeps a `np.random.Generator`, in a DataLoader with workers.
# Expected:  other random numbers for every item and every epoch.
# Happens:   every worker begins with a copy of the generator, in every epoch: two workers give the same numbers, and every
#            epoch repeats them. (NumPy's global generator is seeded by torch; a torch.Generator in the dataset is not.)
# Who:       users who sample goals, crops or noise within `__getitem__`.
# Seen:      three epochs of two workers: [[850, 850, 636, 636], [850, 850, 636, 636], [850, 850, 636, 636]]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torch==2.15.0 numpy==2.4.6
cat >"$folder/repeats.py" <<'PYTHON'
import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset


class Goals(Dataset):
    def __init__(self):
        self.rng = np.random.default_rng(0)

    def __len__(self):
        return 4

    def __getitem__(self, index):
        return int(self.rng.integers(1000))


if __name__ == "__main__":
    loader = DataLoader(Goals(), batch_size=1, num_workers=2)
    epochs = [[int(batch) for batch in loader] for _ in range(3)]
    print(f"torch {torch.__version__}: {epochs}")
    assert epochs[0] == epochs[1] == epochs[2] and epochs[0][0] == epochs[0][1]
PYTHON
"$python" "$folder/repeats.py"

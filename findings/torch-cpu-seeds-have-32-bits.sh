#!/usr/bin/env bash
# Software:  torch 2.15.0 on a CPU: `torch.manual_seed` and `torch.Generator().manual_seed`.
# Expected:  seeds are 64-bit numbers, as `initial_seed` returns them: other seeds, other random numbers.
# Happens:   only the low 32 bits count. Seeds that differ above them give the same numbers, the same weights and the same order of
#            a DataLoader, without a warning; NumPy uses all bits.
# Who:       users who put the run into the high half of a seed and the rank, worker or episode into the low half, or who take
#            multiples of 2**32.
# Seen:      seeds 5, 5 + 2**32 and 5 + 2**40: equal numbers, weights and permutations; NumPy: 3 different permutations
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torch==2.15.0 numpy==2.4.6
"$python" - <<'PYTHON'
import numpy as np
import torch

SEEDS = [5, 5 + 2**32, 5 + 2**40]


def weights(seed):
    torch.manual_seed(seed)
    assert torch.initial_seed() == seed
    return tuple(torch.nn.Linear(2, 2).weight.flatten().tolist())


def order(seed):
    generator = torch.Generator().manual_seed(seed)
    assert generator.initial_seed() == seed
    items = torch.utils.data.DataLoader(range(8), batch_size=8, shuffle=True, generator=generator)
    return tuple(next(iter(items)).tolist())


found = {
    "weights": [weights(seed) for seed in SEEDS],
    "order of a loader": [order(seed) for seed in SEEDS],
    "order of NumPy": [tuple(np.random.default_rng(seed).permutation(8).tolist()) for seed in SEEDS],
}
different = {name: len(set(all)) for name, all in found.items()}
print(f"torch {torch.__version__}, seeds {SEEDS}: different results {different}; orders {found['order of a loader']}")
assert different == {"weights": 1, "order of a loader": 1, "order of NumPy": 3}
assert weights(5) != weights(6) and order(5) != order(6)
PYTHON

#!/usr/bin/env bash
# Software:  webdataset 1.0.2: `WebDataset(…, seed=…).shuffle(n)`.
# Expected:  the order of samples is given by the dataset's `seed`, or by the seeds of `random`, NumPy and torch.
# Happens:   `shuffle` makes a generator of the time and the process: each run has another order, whatever is seeded. `seed` of the
#            dataset is for the order of shards only. `shuffle(n, seed=…)` has one order for all epochs.
# Who:       users who compare trainings by seed, or look for the batch that made a loss NaN.
# Seen:      first samples of 8 runs on equal seeds: 8 orders by shuffle(100), also with WebDataset(seed=1); by detshuffle(100) 1 order,
#            and another one in the next epoch
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages webdataset==1.0.2 numpy==2.4.6
"$python" -W ignore - "$folder/a.tar" <<'PYTHON'
import random
import sys

import numpy as np
import webdataset

with webdataset.TarWriter(sys.argv[1]) as writer:
    for i in range(300):
        writer.write({"__key__": f"sample{i:03}", "cls": i})


def orders(shuffled, **options):
    """How many orders there are in 8 runs on equal seeds, and whether the second epoch has the first one's."""
    found, repeated = set(), set()
    for _ in range(8):
        random.seed(0)
        np.random.seed(0)
        dataset = shuffled(webdataset.WebDataset(sys.argv[1], shardshuffle=False, **options)).decode()
        first, second = (tuple(sample["cls"] for sample in dataset) for _ in range(2))
        found.add(first)
        repeated.add(first == second)
    return len(found), repeated


free = orders(lambda dataset: dataset.shuffle(100))
seeded = orders(lambda dataset: dataset.shuffle(100), seed=1)
fixed = orders(lambda dataset: dataset.shuffle(100, seed=1))
right = orders(lambda dataset: dataset.compose(webdataset.detshuffle(100, seed=1)))
print(f"webdataset {webdataset.__version__}, orders of 8 runs on equal seeds, and whether the second epoch repeats the first:")
print(f"shuffle {free}, WebDataset(seed=1).shuffle {seeded}, shuffle(seed=1) {fixed}, detshuffle(seed=1) {right}")
assert free == seeded == (8, {False}) and fixed == (1, {True}) and right == (1, {False})
PYTHON

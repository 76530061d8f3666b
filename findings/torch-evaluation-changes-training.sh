#!/usr/bin/env bash
# Software:  torch 2.15.0: `DataLoader` without workers and without shuffling.
# Expected:  iterating over a validation set in order takes no random number.
# Happens:   each `iter(loader)` samples a seed for workers from the global generator, also where there are none (its manual says so of
#            workers): dropout, noise and the order of training differ from there on. A loader with a `generator` of its own does not.
# Who:       users who compare runs of one seed that are validated at other intervals, or of which one is not: weights differ though
#            nothing of the training does.
# Seen:      order of the second epoch after 0, 1 and 2 validations: 0 3 7 1 6 2 5 4, 6 1 3 4 7 0 5 2 and 5 7 1 6 2 0 3 4; with a generator of
#            its own for the validation: the first one each time
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torch==2.15.0 numpy==2.4.6
"$python" -W ignore - <<'PYTHON'
import torch
from torch.utils.data import DataLoader

rows = list(range(8))


def second_epoch(validations, generator=None):
    """The order of the second epoch, the noise after it."""
    torch.manual_seed(0)
    training = DataLoader(rows, shuffle=True, batch_size=None)
    validation = DataLoader(rows, shuffle=False, num_workers=0, generator=generator)
    list(training)
    for _ in range(validations):
        assert [int(row) for row in validation] == rows
    return [int(row) for row in training], round(torch.randn(1).item(), 4)


found = {validations: second_epoch(validations) for validations in (0, 1, 2)}
apart = {validations: second_epoch(validations, torch.Generator()) for validations in (0, 1, 2)}
print(f"torch {torch.__version__}, order of the second epoch and noise after it, by validations before it: {found}")
print(f"with generator=torch.Generator() for the validation: {apart}")
assert len(set(map(str, found.values()))) == 3 and second_epoch(1) == found[1]
assert len(set(map(str, apart.values()))) == 1 and apart[0] == found[0]
PYTHON

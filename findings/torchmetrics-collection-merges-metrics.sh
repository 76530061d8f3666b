#!/usr/bin/env bash
# Software:  torchmetrics 1.9.0: `MetricCollection` by `update`.
# Expected:  each metric of the collection has the value that it has alone.
# Happens:   metrics whose states are equal after the first batch share one state from then on, also where they differ in an argument
#            that decides what is counted, such as `threshold`: both have the value of the first. `reset` does not part them. (The manual
#            describes shared states for metrics that differ only in how they compute a result.)
# Who:       users who log success or accuracy at several thresholds, where the first batch is all right, or all wrong.
# Seen:      success at 0.5 and 0.9 of two batches: 1.0 and 1.0 in a collection, 1.0 and 0.5 alone
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torchmetrics==1.9.0 torch==2.15.0
"$python" -W ignore - <<'PYTHON'
import torch
import torchmetrics
from torchmetrics.classification import BinaryAccuracy


def metrics():
    return {"at_50": BinaryAccuracy(threshold=0.5), "at_90": BinaryAccuracy(threshold=0.9)}


def values(collection):
    return {name: value.item() for name, value in collection.compute().items()}


sure = torch.tensor([0.95, 0.98, 0.02, 0.01]), torch.tensor([1, 1, 0, 0])
unsure = torch.tensor([0.6, 0.7, 0.8, 0.6]), torch.tensor([1, 1, 1, 1])

together, apart = torchmetrics.MetricCollection(metrics()), torchmetrics.MetricCollection(metrics(), compute_groups=False)
for collection in (together, apart):
    for batch in (sure, unsure):
        collection.update(*batch)
alone = metrics()
for one in alone.values():
    for batch in (sure, unsure):
        one.update(*batch)
alone = {name: one.compute().item() for name, one in alone.items()}
found, right = values(together), values(apart)
together.reset()
together.update(*unsure)
again = values(together)

print(f"torchmetrics {torchmetrics.__version__}: alone {alone}, together {found}, with compute_groups=False {right}")
print(f"after reset, on the second batch: {again}, which is right as {{'at_50': 1.0, 'at_90': 0.0}}")
assert alone == right == {"at_50": 1, "at_90": 0.5} and found == again == {"at_50": 1, "at_90": 1}
PYTHON

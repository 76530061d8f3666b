#!/usr/bin/env bash
# Software:  torch 2.15.0: `swa_utils.AveragedModel` with `get_ema_multi_avg_fn` of a model in bfloat16.
# Expected:  the average follows the model, kept in a type that can hold its small steps.
# Happens:   the average has the type of the model, in which a step of 0.001 of the difference is rounded away once it is less than half
#            a unit in the last place: it stops far from the model, for good. With a decay of 0.999 it cannot come near in bfloat16.
# Who:       users who train in bfloat16 with an EMA: target encoders of JEPA and BYOL, target networks, averaged policies.
# Seen:      a weight of 1 whose average began at 0, after 10,000 steps: 0.25 in bfloat16, 1.0 in float32
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torch==2.15.0 numpy==2.4.6
"$python" -W ignore - <<'PYTHON'
import copy

import torch
from torch.optim.swa_utils import AveragedModel, get_ema_avg_fn, get_ema_multi_avg_fn


def averaged(dtype, decay, steps=10_000, wide=False):
    model = torch.nn.Linear(1, 1, bias=False, dtype=dtype)
    torch.nn.init.zeros_(model.weight)
    if wide:
        average = AveragedModel(copy.deepcopy(model).float(), avg_fn=get_ema_avg_fn(decay))
    else:
        average = AveragedModel(model, multi_avg_fn=get_ema_multi_avg_fn(decay))
    average.update_parameters(model)
    torch.nn.init.ones_(model.weight)
    for _ in range(steps):
        average.update_parameters(model)
    return average.module.weight.item()


found = {(dtype, decay): averaged(dtype, decay) for dtype in (torch.bfloat16, torch.float32) for decay in (0.99, 0.999, 0.9999)}
wide = averaged(torch.bfloat16, 0.999, wide=True)
print(f"torch {torch.__version__}: average of a weight that is 1 after 10,000 steps, from 0: {found}")
print(f"in bfloat16 with an average in float32, decay 0.999: {wide}")
assert found[torch.bfloat16, 0.999] < 0.3 and found[torch.bfloat16, 0.99] < 0.9 and found[torch.bfloat16, 0.9999] < 0.1
assert found[torch.float32, 0.999] > 0.99 and wide > 0.99
PYTHON

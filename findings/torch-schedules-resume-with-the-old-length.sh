#!/usr/bin/env bash
# Software:  torch 2.15.0: `load_state_dict` of learning-rate schedules, when a training is resumed with more steps than it began with.
# Expected:  the schedule that was made for the new length goes on from the step of the checkpoint.
# Happens:   the state has the settings, too (`T_max`, `total_iters`, …), which replace those of the new schedule without a word: the
#            cosine reaches its minimum at the old end and rises again, to the full learning rate.
# Who:       users who extend a training: `T_max` from the new number of steps, then the checkpoint's state.
# Seen:      from step 5 of 10 to step 20 by CosineAnnealingLR(T_max=20): T_max is 10, 0.0 at step 10, 1.0 at step 20; without loading
#            0.0 at step 20
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torch==2.15.0 numpy==2.4.6
"$python" -W ignore - <<'PYTHON'
import math

import torch
from torch.optim.lr_scheduler import CosineAnnealingLR, LambdaLR, LinearLR


def schedule(kind):
    weight = torch.nn.Parameter(torch.zeros(1))
    optimizer = torch.optim.SGD([weight], lr=1.0)
    return optimizer, kind(optimizer)


def rates(optimizer, scheduler, steps):
    found = []
    for _ in range(steps):
        optimizer.step()
        scheduler.step()
        found.append(round(optimizer.param_groups[0]["lr"], 3))
    return found


def resumed(kind, setting, drop=()):
    """Rates of steps 6 to 20, by a schedule of 20 steps that continues one of 10 steps at step 5, and its length."""
    optimizer, scheduler = schedule(lambda optimizer: kind(optimizer, 10))
    rates(optimizer, scheduler, 5)
    state = optimizer.state_dict(), scheduler.state_dict()
    optimizer, scheduler = schedule(lambda optimizer: kind(optimizer, 20))
    optimizer.load_state_dict(state[0])
    scheduler.load_state_dict({name: value for name, value in state[1].items() if name not in drop})
    return rates(optimizer, scheduler, 15), getattr(scheduler, setting, None)


def by_lambda(optimizer, steps):
    return LambdaLR(optimizer, lambda step: (1 + math.cos(math.pi * step / steps)) / 2)


def cosine_of(optimizer, steps):
    return CosineAnnealingLR(optimizer, T_max=steps)


cosine, length = resumed(cosine_of, "T_max")
linear, total = resumed(lambda optimizer, steps: LinearLR(optimizer, 1.0, 0.1, total_iters=steps), "total_iters")
dropped, _ = resumed(cosine_of, "T_max", ["T_max"])
from_lambda, _ = resumed(by_lambda, "")
whole = rates(*schedule(lambda optimizer: CosineAnnealingLR(optimizer, T_max=20)), 20)
print(f"torch {torch.__version__}: cosine over 20 steps {whole}")
print(f"steps 6 to 20 of it after loading step 5 of 10: T_max {length}, {cosine}")
print(f"the same for LinearLR: total_iters {total}, {linear}")
print(f"without T_max in the state {dropped}; LambdaLR {from_lambda}")
assert dropped[-1] == 0 and dropped == sorted(dropped, reverse=True) and from_lambda == whole[5:]
assert length == 10 and cosine[4] == 0 and cosine[-1] == 1 and whole[-1] == 0
assert total == 10 and linear[4] == 0.1
PYTHON

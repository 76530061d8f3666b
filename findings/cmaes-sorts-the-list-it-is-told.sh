#!/usr/bin/env bash
# Software:  cmaes 0.13.1: `CMA.tell` and `SepCMA.tell`.
# Expected:  `tell` reads the solutions; a NaN as a value counts as the worst one or is an error.
# Happens:   it sorts the list that it is given: costs that were kept in the order of `ask` belong to other solutions after it. A NaN
#            leaves that list out of order, so that the distribution moves toward solutions that are not the best.
# Who:       planners that keep the best plan by `solutions[argmin(costs)]` after `tell`, and those whose rollouts can diverge.
# Seen:      least cost 4.66, cost of the plan at its index 8.29; squared distance to the optimum after 30 generations, a fifth of the
#            costs being NaN: 0.17 (CMA), 0.31 (SepCMA), and with 1e9 in their place 0.013, 0.0025
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages cmaes==0.13.1 numpy==2.4.6
"$python" - <<'PYTHON'
from importlib.metadata import version

import cmaes
import numpy as np


def cost(plan):
    return float(((plan - 3) ** 2).sum())


def kept(kind):
    optimizer = kind(mean=np.zeros(2), sigma=1.0, seed=0)
    plans = [optimizer.ask() for _ in range(optimizer.population_size)]
    costs = [cost(plan) for plan in plans]
    solutions = list(zip(plans, costs))
    optimizer.tell(solutions)
    return min(costs), cost(solutions[int(np.argmin(costs))][0])


def distance(kind, failed):
    optimizer, rng, unsorted = kind(mean=np.zeros(4), sigma=1.0, seed=0), np.random.default_rng(1), 0
    for _ in range(30):
        plans = [optimizer.ask() for _ in range(optimizer.population_size)]
        solutions = [(plan, failed if rng.random() < 0.2 else cost(plan)) for plan in plans]
        optimizer.tell(solutions)
        finite = [value for _, value in solutions if np.isfinite(value)]
        unsorted += finite != sorted(finite)
    return cost(optimizer.mean), unsorted


for kind in (cmaes.CMA, cmaes.SepCMA):
    least, at_index = kept(kind)
    nan, large = distance(kind, np.nan), distance(kind, 1e9)
    print(f"cmaes {version('cmaes')}, {kind.__name__}: least cost {least:.2f}, at its index after tell {at_index:.2f}; "
          f"distance and generations out of order: NaN {nan}, 1e9 {large}")
    assert least < at_index and nan[0] > 2 * large[0] and nan[1] > 0 and large[1] == 0
PYTHON

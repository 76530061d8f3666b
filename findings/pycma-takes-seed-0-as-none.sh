#!/usr/bin/env bash
# Software:  cma 4.5.0 (pycma): the option `seed` of `CMAEvolutionStrategy`.
# Expected:  seed 0 is a seed like 1, and the seed is that of the strategy.
# Happens:   0 means the time, so that every run differs. Any seed is given to NumPy's global generator, from which the strategy
#            samples: making one sets the random numbers of the whole program, and two strategies side by side mix theirs.
# Who:       users who plan or tune by pycma on seeds from 0 up, beside environments or noise on NumPy's global generator.
# Seen:      first candidates of four runs, seed 0: 4 different, seed 1: 1; np.random after global seeds 7 and 8: equal
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages cma==4.5.0 numpy==2.4.6
"$python" -W ignore - <<'PYTHON'
import time

import cma
import numpy as np


def strategy(seed, **options):
    return cma.CMAEvolutionStrategy([0, 0], 0.5, {"seed": seed, "verbose": -9, **options})


def first(one):
    return tuple(round(float(value), 6) for value in one.ask()[0])


def different(seed):
    found = set()
    for _ in range(4):
        found.add(first(strategy(seed)))
        time.sleep(0.05)
    return len(found)


def number_after(seed):
    np.random.seed(seed)
    strategy(3)
    return round(np.random.random(), 6)


def own(seed):
    return strategy(np.nan, randn=lambda *shape: np.random.default_rng(seed).standard_normal(shape))


zero, one = different(0), different(1)
after = [number_after(7), number_after(8)]
alone = first(strategy(4))
beside = strategy(4)
strategy(5)
mixed = first(beside)
with_own = [first(own(0)), first(own(0)), first(own(1))]
print(f"cma {cma.__version__}: first candidates of 4 runs: seed 0: {zero} different, seed 1: {one}")
print(f"np.random after seeds 7 and 8 and a strategy: {after}; seed 4 alone {alone}, beside another strategy {mixed}")
assert zero == 4 and one == 1 and after[0] == after[1] and alone != mixed
assert with_own[0] == with_own[1] != with_own[2]
PYTHON

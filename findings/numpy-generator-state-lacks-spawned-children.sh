#!/usr/bin/env bash
# Software:  NumPy 2.4.6: `Generator.bit_generator.state`, and `Generator.spawn`.
# Expected:  a generator whose state was saved and restored goes on as the original does.
# Happens:   its numbers do, and `spawn` does not: the state has neither the seed nor the count of children. After a resume, a
#            generator of the same seed gives its first children once more; one without a seed gives others in every process.
# Who:       users who keep the state in checkpoints and spawn a generator for each episode, worker or epoch.
# Seen:      children 1 to 4: 802, 662, 656, 892; after two and a resume: 802, 662 in place of 656, 892
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages numpy==2.4.6
"$python" - <<'PYTHON'
import pickle

import numpy as np


def children(generator):
    return [int(child.integers(1000)) for child in generator.spawn(2)]


generator = np.random.default_rng(0)
first = children(generator)
state, pickled = generator.bit_generator.state, pickle.dumps(generator)
numbers, second = generator.integers(1000, size=3).tolist(), children(generator)

resumed = np.random.default_rng(0)
resumed.bit_generator.state = state
resumed_numbers, resumed_children = resumed.integers(1000, size=3).tolist(), children(resumed)
unpickled = children(pickle.loads(pickled))
print(f"NumPy {np.__version__}: children {first}, then {second}; numbers {numbers}")
print(f"by state: children {resumed_children}, numbers {resumed_numbers}; by pickle: children {unpickled}")
assert resumed_numbers == numbers and resumed_children == first != second == unpickled
PYTHON

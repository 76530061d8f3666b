#!/usr/bin/env bash
# Software:  numpy 2.5.5 (Python 3.12 or later): lists as seeds of `default_rng` and `SeedSequence`.
# Expected:  each list is a seed of its own: `[seed, worker]` differs from `seed` and from the lists of other seeds.
# Happens:   zeros at the end of a list of up to 4 numbers do not count, and a number from 2**32 up counts as two: worker 0 has the
#            numbers of the main process, and `[2**32 + 7]` those of worker 1 of seed 7. `spawn` does not collide.
# Who:       users who give `[seed, worker]` or `[seed, episode]` to workers and `seed` to the main process: exploration, goals or
#            noise of worker 0 repeat the numbers by which weights or the split of the data were made.
# Seen:      equal: 7, [7], [7, 0], [7, 0, 0] and [7, 0, 0, 0]; [7, 1] and 2**32 + 7; [7, 0] and the first spawned one are not
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages numpy==2.5.5
"$python" - <<'PYTHON'
import numpy as np


def numbers(seed):
    return np.random.default_rng(seed).integers(2**32, size=4).tolist()


zeros = [7, [7], [7, 0], [7, 0, 0], [7, 0, 0, 0]]
pairs = [[7, 1], 2**32 + 7]
print(f"numpy {np.__version__}:", *(f"{seed} {numbers(seed)[:2]}" for seed in zeros + pairs))
assert all(numbers(seed) == numbers(7) for seed in zeros) and numbers([7, 0, 0, 0, 0]) != numbers(7)
assert numbers(pairs[0]) == numbers(pairs[1]) != numbers(7)
# The order that NumPy's pages show, the worker first, collides for seed 0 only.
assert numbers([0, 7]) != numbers(7) and numbers([3, 0]) == numbers(3)
spawned = [tuple(numbers(child)) for child in np.random.SeedSequence(7).spawn(4)]
assert len({tuple(numbers(7)), *spawned}) == 5
PYTHON

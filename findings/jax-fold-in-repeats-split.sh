#!/usr/bin/env bash
# Software:  jax 0.12.0.1: `jax.random.split` and `jax.random.fold_in` on one key.
# Expected:  keys that two functions derive from a key are as different as those that one derives.
# Happens:   `fold_in(key, i)` is `split(key, n)[i]` for every n: keys of parameters and of the first steps are the same. (So by intent
#            since `jax_threefry_partitionable` is the default; no manual page says it.)
# Who:       users who split a seed's key into parts, and derive a key for each step or episode from it by `fold_in`, too.
# Seen:      of 4 keys of each 4 are equal; correlation of initial weights with the noise of step 0: 1.0
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages jax==0.12.0.1
"$python" -W ignore - <<'PYTHON'
import jax
import numpy as np

key = jax.random.key(0)
equal = [
    bool((jax.random.key_data(one) == jax.random.key_data(jax.random.fold_in(key, i))).all())
    for i, one in enumerate(jax.random.split(key, 4))
]
for_weights, for_environment = jax.random.split(key)


def correlation(step_key):
    weights, noise = jax.random.normal(for_weights, (1000,)), jax.random.normal(step_key, (1000,))
    return float(np.corrcoef(weights, noise)[0, 1])


same = correlation(jax.random.fold_in(key, 0))
key_of_steps = jax.random.split(key, 3)[2]
apart = correlation(jax.random.fold_in(key_of_steps, 0))
print(f"jax {jax.__version__}: split(key, 4)[i] equals fold_in(key, i): {equal}")
print(f"correlation of weights by split(key)[0] with noise by fold_in(key, 0): {same:.3f}; from a key of its own {apart:.3f}")
assert all(equal) and same > 0.999 and abs(apart) < 0.2
PYTHON

#!/usr/bin/env bash
# Software:  optax 0.2.8 with jax 0.12.0.1: `inject_hyperparams` on parameters in bfloat16.
# Expected:  hyperparameters have the values that they are given, whatever the type of the parameters.
# Happens:   they are kept in the widest type among the parameters. Where all are bfloat16, b2=0.999, the default of Adam, is 1, and updates
#            are NaN from the first step on, without an error; `optax.adam` itself trains. b2=0.99 is 0.988, b1=0.9 is 0.898.
# Who:       users who change or log the learning rate by `opt_state.hyperparams`, with models in bfloat16.
# Seen:      first update of adam -0.001, injected NaN with b2 1.0, with hyperparam_dtype=float32 -0.001
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages optax==0.2.8 jax==0.12.0.1 numpy==2.4.6
JAX_PLATFORMS=cpu "$python" -W ignore - <<'PYTHON'
from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np
import optax


def first_update(optimizer, params):
    """Of one value, with the betas of the state."""
    state = optimizer.init(params)
    updates, state = optimizer.update(jax.tree.map(lambda leaf: leaf / 2, params), state, params)
    betas = {name: float(value) for name, value in getattr(state, "hyperparams", {}).items() if name in ("b1", "b2")}
    return np.float64(updates["w"][0]).round(6).item(), betas


narrow, wide = ({"w": jnp.ones(2, dtype)} for dtype in (jnp.bfloat16, jnp.float32))
injected = optax.inject_hyperparams(optax.adam)
found = {
    "adam": first_update(optax.adam(1e-3), narrow),
    "injected": first_update(injected(1e-3), narrow),
    "injected, b2=0.99": first_update(injected(1e-3, b2=0.99), narrow),
    "injected, parameters in float32": first_update(injected(1e-3), wide),
    "hyperparam_dtype=float32": first_update(optax.inject_hyperparams(optax.adam, hyperparam_dtype=jnp.float32)(1e-3), narrow),
}
for name, (update, betas) in found.items():
    print(f"optax {version('optax')}, {name}: first update {update}, {betas}")
nan = {name: bool(np.isnan(update)) for name, (update, _) in found.items()}
assert nan == {name: name == "injected" for name in found}
assert found["injected"][1]["b2"] == 1 and found["injected, b2=0.99"][1]["b2"] == 0.98828125
PYTHON

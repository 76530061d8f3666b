#!/usr/bin/env bash
# Software:  flax 0.12.12 with jax 0.12.0.1, float32 on a CPU: `LayerNorm` of linen and nnx as it is made unasked.
# Expected:  values of mean 0 and std 1, as torch's LayerNorm gives for inputs of any mean.
# Happens:   the variance is the mean of squares less the square of the mean, in float32: where the mean is far larger than the std,
#            it is off or 0, and the output grows by up to 1000. (The manual calls `use_fast_variance` less numerically stable.)
# Who:       users who normalize raw features, positions in millimeters or pixels, or residual streams whose mean has drifted; and who
#            carry weights over from torch.
# Seen:      std of the output for inputs of mean 1000 and std 0.1: 93 to 104; mean 100 and std 0.1: 0.97 to 1.33; without it 1.000
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages flax==0.12.12 jax==0.12.0.1
"$python" -W ignore - <<'PYTHON'
import flax
import jax
import jax.numpy as jnp
import numpy as np
from flax import linen, nnx


def stds(mean, std, **options):
    x = jnp.asarray(np.random.default_rng(0).normal(mean, std, (4, 512)), jnp.float32)
    layer = linen.LayerNorm(**options)
    by_linen = layer.apply(layer.init(jax.random.key(0), x), x).std(axis=-1)
    by_nnx = nnx.LayerNorm(512, rngs=nnx.Rngs(0), **options)(x).std(axis=-1)
    return np.asarray(by_linen).round(3).tolist(), np.asarray(by_nnx).round(3).tolist()


print(f"flax {flax.__version__}, jax {jax.__version__}, on {jax.default_backend()}: std of the output of linen and nnx")
found = {}
for mean, std in ((0, 0.1), (100, 0.1), (1000, 0.1)):
    found[mean] = stds(mean, std), stds(mean, std, use_fast_variance=False)
    print(f"inputs of mean {mean} and std {std}: {found[mean][0]}; use_fast_variance=False: {found[mean][1]}")
assert all(abs(value - 1) < 0.01 for layers in found.values() for one in layers[1] for value in one)
assert all(abs(value - 1) < 0.01 for one in found[0][0] for value in one)
assert all(max(one) > 10 for one in found[1000][0]) and all(max(np.abs(np.array(one) - 1)) > 0.02 for one in found[100][0])
PYTHON

#!/usr/bin/env bash
# Software:  jax 0.12.0.1: `random` with `dtype` or parameters in bfloat16.
# Expected:  numbers as of float32, rounded to bfloat16.
# Happens:   all come from one of 128 uniform values: `bernoulli` of any p below 1/128 but 0 is true once in 128; the noise of `categorical`
#            ties, and the first of the best is taken; `normal` has 128 values, none below -2.9 or above 2.6. No warning.
# Who:       users whose models compute in bfloat16: a policy or a discrete latent over equal logits prefers low indices, an end of the episode
#            that is predicted with 0.1 % comes 8 times as often, and noise of diffusion and exploration has no tails.
# Seen:      bernoulli(0.001) 0.0078; of 64 equal logits the first 8 have 15.4 % and the last 8 9.9 %; normal from -2.89 to 2.52 in 65,536
#            numbers (float32: 0.0010; 12.4 % and 12.5 %; -4.37 to 4.29)
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages jax==0.12.0.1 numpy==2.4.6
JAX_PLATFORMS=cpu "$python" -W ignore - <<'PYTHON'
import jax
import jax.numpy as jnp
import numpy as np

COUNT = 65_536
keys = jax.random.split(jax.random.key(0), 3)


def seen(dtype):
    rare = float(jax.random.bernoulli(keys[0], jnp.asarray(0.001, dtype), (COUNT,)).mean())
    chosen = np.bincount(np.asarray(jax.random.categorical(keys[1], jnp.zeros(64, dtype), shape=(COUNT,))), minlength=64)
    noise = np.asarray(jax.random.normal(keys[2], (COUNT,), dtype).astype(jnp.float32))
    return {
        "bernoulli(0.001)": round(rare, 5),
        "share of the first 8 of 64": round(float(chosen[:8].sum() / COUNT), 3),
        "share of the last 8": round(float(chosen[-8:].sum() / COUNT), 3),
        "normal, least": round(float(noise.min()), 2),
        "greatest": round(float(noise.max()), 2),
        "values": len(np.unique(noise)),
    }


narrow, wide = seen(jnp.bfloat16), seen(jnp.float32)
print(f"jax {jax.__version__}, bfloat16: {narrow}")
print(f"float32: {wide}; of 64 equal logits 8 are {8 / 64}")
assert 0.006 < narrow["bernoulli(0.001)"] < 0.01 and 0.0005 < wide["bernoulli(0.001)"] < 0.002
assert narrow["share of the first 8 of 64"] > 0.14 > 0.11 > narrow["share of the last 8"]
assert abs(wide["share of the first 8 of 64"] - 0.125) < 0.01 and abs(wide["share of the last 8"] - 0.125) < 0.01
assert narrow["values"] == 128 and narrow["normal, least"] > -3 and narrow["greatest"] < 2.6 and wide["greatest"] > 3.5
PYTHON

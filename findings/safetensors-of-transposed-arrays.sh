#!/usr/bin/env bash
# Software:  safetensors 0.8.0 with NumPy arrays.
# Expected:  what `save` wrote is what `load` gives.
# Happens:   of a transposed array the memory is written as it lies, under the transposed shape: other values, no error.
# Who:       users who export weights of PyTorch or JAX by NumPy (`layer.weight.numpy().T`) for a model here.
# Seen:      saved [[0.0, 3.0], [1.0, 4.0], [2.0, 5.0]], loaded [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages safetensors==0.8.0 numpy==2.4.6
"$python" - <<'PYTHON'
import numpy as np
import safetensors
from safetensors.numpy import load, save

weights = np.arange(6, dtype=np.float32).reshape(2, 3).T
loaded = load(save({"w": weights}))["w"]
print(f"safetensors {safetensors.__version__}: saved {weights.tolist()}, loaded {loaded.tolist()}")
assert loaded.shape == weights.shape and loaded.tolist() == [[0, 1], [2, 3], [4, 5]]
assert (load(save({"w": np.ascontiguousarray(weights)}))["w"] == weights).all()
PYTHON

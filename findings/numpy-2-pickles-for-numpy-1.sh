#!/usr/bin/env bash
# Software:  NumPy 2.4.6 and 1.24.4 (Python 3.11): a pickled scaler, or an .npz with objects.
# Expected:  arrays in pickles are read by any NumPy.
# Happens:   NumPy 2 names its module `numpy._core`, which NumPy below 1.26 does not have.
# Who:       users who keep scalers of `process=` beside weights, and evaluate in an older environment of a peer.
# Seen:      1.24.4: ModuleNotFoundError: No module named 'numpy._core'
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.11
packages numpy==2.4.6
"$python" -c 'import numpy, pickle, sys; pickle.dump({"mean": numpy.zeros(2)}, open(sys.argv[1], "wb"))' "$folder/scaler.pkl"
packages numpy==1.24.4
"$python" - "$folder/scaler.pkl" <<'PYTHON'
import pickle
import sys

import numpy as np

try:
    pickle.load(open(sys.argv[1], "rb"))
    raise SystemExit("is read: changed")
except ModuleNotFoundError as error:
    print(f"NumPy {np.__version__}: ModuleNotFoundError: {error}")
    assert "numpy._core" in str(error)
PYTHON

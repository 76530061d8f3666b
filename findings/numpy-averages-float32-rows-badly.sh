#!/usr/bin/env bash
# Software:  numpy 2.4.6: `mean`, `std` and `sum` of float32 with `axis=0`.
# Expected:  statistics of a column that are right to float32 precision, as `column.mean()` gives them.
# Happens:   along the rows, values are added one after the other in float32, and by halves otherwise: of 10 million rows, means are off by
#            several percent, and a mean of ones cannot get over 2**24 / rows. (A note of `mean` has that float32 can be inaccurate.)
# Who:       users who normalize observations or actions of large datasets by `values.mean(axis=0)` and `values.std(axis=0)`.
# Seen:      10 million rows of mean 0.6 and std 0.05: mean 0.563, std 0.061; 20 million ones: mean 0.839
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages numpy==2.4.6
"$python" - <<'PYTHON'
import numpy as np

rng = np.random.default_rng(0)
rows = np.float32(0.6) + np.float32(0.05) * rng.standard_normal((10_000_000, 2), dtype=np.float32)
mean, std = float(rows.mean(axis=0)[0]), float(rows.std(axis=0)[0])
column = float(rows[:, 0].mean()), float(rows[:, 0].std())
wide = float(rows.mean(axis=0, dtype=np.float64)[0]), float(rows.std(axis=0, dtype=np.float64)[0])
half = float(rows[:5_000_000].mean(axis=0)[0])
ones = float(np.ones((20_000_000, 2), np.float32).mean(axis=0)[0])

print(f"numpy {np.__version__}: axis=0: mean {mean:.4f}, std {std:.4f}; the column: mean {column[0]:.4f}, std {column[1]:.4f}")
print(f"with dtype=np.float64: mean {wide[0]:.4f}, std {wide[1]:.4f}; 5 million rows: mean {half:.4f}")
print(f"20 million rows of ones: mean {ones:.4f}")
assert mean < 0.58 and std > 0.055 and ones < 0.84 and half < 0.599
assert all(abs(one[0] - 0.6) < 1e-4 and abs(one[1] - 0.05) < 1e-4 for one in (column, wide))
PYTHON

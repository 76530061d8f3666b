#!/usr/bin/env bash
# Software:  pandas 3.1.1: `rolling`, `expanding` and `ewm`.
# Expected:  an infinite value counts: the mean of a window with one is infinite, as `Series.mean`, `cumsum` and `groupby` have it.
# Happens:   infinite values become missing ones before anything is computed, without a warning or a word in the docstrings: a window's mean and
#            maximum are those of the other values, only `count` has it; with `min_periods` of the window, as unasked, the result is NaN,
#            which plots leave out; `ewm` goes on as if the row were empty.
# Who:       users who smooth losses, costs and returns: a run that diverges at every fifth step has the smooth curve of one that does not,
#            and the run with the least smoothed cost can be one whose plans fail.
# Seen:      losses inf, 2, 2, 2, 2, inf, 2, …: mean inf; from row 1 on rolling mean and maximum of 5, expanding and exponential mean are 2;
#            of 1, inf, 2 the maximum is 2 and the count 3
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pandas==3.1.1 numpy==2.5.5
"$python" -W error - <<'PYTHON'
import numpy as np
import pandas

INF = np.inf
loss = pandas.Series([INF, 2.0, 2.0, 2.0, 2.0] * 4)
window = loss.rolling(5, min_periods=1)
smooth = {
    "rolling mean": window.mean()[1:],
    "rolling max": window.max()[1:],
    "expanding mean": loss.expanding().mean()[1:],
    "ewm mean": loss.ewm(alpha=0.2).mean()[1:],
}
ranges = {name: (float(values.min()), float(values.max())) for name, values in smooth.items()}
other = pandas.Series([1.0, INF, 2.0])
one = {
    "max": other.rolling(3, min_periods=1).max().tolist(),
    "count": other.rolling(3, min_periods=1).count().tolist(),
    "mean of 2": other.rolling(2).mean().tolist(),
}
whole = (float(loss.mean()), float(loss.groupby(loss.index // 5).mean().min()), other.max(), other.cummax().tolist())
print(f"pandas {pandas.__version__}, losses of which a fifth is infinite, least and greatest from row 1 on: {ranges}")
print(f"of 1, inf, 2: {one}; mean, means by group, max and cummax without windows: {whole}")
assert all(np.allclose(values, 2) for values in smooth.values())
assert one["max"] == [1, 1, 2] and one["count"] == [1, 2, 3] and np.isnan(one["mean of 2"]).all()
assert whole == (INF, INF, INF, [1, INF, INF])
PYTHON

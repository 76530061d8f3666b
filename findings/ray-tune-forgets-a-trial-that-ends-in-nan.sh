#!/usr/bin/env bash
# Software:  ray[tune] 2.60.0.
# Expected:  `get_best_result(…, scope="all")` finds the best value that any trial reported.
# Happens:   a trial whose last value is NaN counts for nothing, its earlier values included; where all end so there is no
#            best trial. With filter_nan_and_inf=False a trial of NaN that comes first is the best one.
# Who:       users who tune trainings or planners here by Ray, with a metric that can be NaN at the end.
# Seen:      scope last: RuntimeError; scope all: RuntimeError; unfiltered: the trial of NaN
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages 'ray[tune]==2.60.0'
RAY_AIR_NEW_OUTPUT=0 "$python" - "$folder" 2>/dev/null <<'PYTHON' | grep '^> '
import sys

import ray
from ray import tune

ray.init(num_cpus=1, include_dashboard=False, logging_level="ERROR", log_to_driver=False)


def run(trainable, count):
    config = tune.RunConfig(storage_path=sys.argv[1], verbose=0)
    return tune.Tuner(trainable, param_space={"i": tune.grid_search(list(range(count)))}, run_config=config).fit()


def ends_in_nan(config):
    for step in range(3):
        tune.report({"score": float("nan") if step == 2 else float(step + config["i"])})


def first_is_nan(config):
    tune.report({"score": float("nan") if config["i"] == 0 else float(config["i"])})


grid = run(ends_in_nan, 2)
for scope in ("last", "all"):
    try:
        grid.get_best_result("score", "max", scope=scope)
        raise SystemExit(1)
    except RuntimeError as error:
        print(f"> ray {ray.__version__}: scope {scope}: RuntimeError: {str(error)[:48]}")
best = run(first_is_nan, 3).get_best_result("score", "max", filter_nan_and_inf=False)
print(f"> unfiltered: trial {best.config['i']}, score {best.metrics['score']}")
assert best.config["i"] == 0
PYTHON

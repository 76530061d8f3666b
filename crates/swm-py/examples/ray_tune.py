#!/usr/bin/env python3
"""Searches settings of a planner with Ray Tune: each trial is an evaluation on one manifest, with several seeds.

    pip install 'ray[tune]' stable_worldmodel_rs-*.whl
    python ray_tune.py --samples 16 64 256 --seeds 0 1 2

Trials differ in nothing but the settings and the seed: they are compared pair by pair, and every one has a receipt.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ray import tune

import stable_worldmodel_rs as swm


def trial(config: dict[str, Any]) -> dict[str, Any]:
    """One evaluation; gives the rate and its interval."""
    policy = f"cem:samples={config['samples']},iterations={config['iterations']},elites={max(2, config['samples'] // 10)}"
    name = f"samples-{config['samples']}-seed-{config['seed']}"
    receipt = swm.evaluate(
        config["task"], policy, Path(config["out"]) / name, policy_seed=config["seed"], references=[], threads=1, progress=False
    )
    low, high = receipt.interval
    return {"success_rate": receipt.success_rate, "low": low, "high": high, "result": str(Path(config["out"]) / name)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--env", default="swm/PushT-v1")
    parser.add_argument("--task", type=Path, default=Path("task.toml"), help="manifest; made if it does not exist")
    parser.add_argument("--episodes", type=int, default=50, help="of a manifest that is made")
    parser.add_argument("--budget", type=int, default=50, help="of a manifest that is made")
    parser.add_argument("--samples", type=int, nargs="+", default=[16, 64, 256])
    parser.add_argument("--iterations", type=int, default=5)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--out", type=Path, default=Path("tuned"))
    options = parser.parse_args()

    if not options.task.exists():
        swm.make_manifest(options.task, options.env, episodes=options.episodes, budget=options.budget)
    space = {
        "samples": tune.grid_search(options.samples),
        "seed": tune.grid_search(options.seeds),
        "iterations": options.iterations,
        "task": str(options.task.resolve()),
        "out": str(options.out.resolve()),
    }
    # Results depend neither on the machine nor on what else runs there.
    results = tune.Tuner(trial, param_space=space, tune_config=tune.TuneConfig(metric="success_rate", mode="max")).fit()
    print(f"best: samples={results.get_best_result().config['samples']}")
    # A side is all seeds of one setting.
    sides = [[options.out / f"samples-{samples}-seed-{seed}" for seed in options.seeds] for samples in options.samples]
    print(swm.compare(*sides))


if __name__ == "__main__":
    main()

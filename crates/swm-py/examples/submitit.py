#!/usr/bin/env python3
"""Evaluates a policy in parts, each a job of a cluster, and puts the parts together.

    pip install submitit stable_worldmodel_rs-*.whl
    python submitit.py --policy cem --parts 8 --partition gpu          # on Slurm
    python submitit.py --policy random --parts 2 --cluster local       # processes of this machine

A job that was killed is repeated by the same command: what is in the folder is not computed again. All machines need to see the folder.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

# This file has the name of the package: its own folder must not come first.
sys.path[:] = [path for path in sys.path if Path(path or ".").resolve() != Path(__file__).resolve().parent]

import submitit  # noqa: E402

import stable_worldmodel_rs as swm  # noqa: E402


def part(task: str, policy: str, out: str, index: int, parts: int, references: list[str]) -> int:
    """One job: part ``index`` of ``parts``, counted from 1."""
    swm.evaluate(task, policy, out, references=references, shard=(index, parts), progress=False)
    return index


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--env", default="swm/PushT-v1")
    parser.add_argument("--task", type=Path, default=Path("task.toml"), help="manifest; made if it does not exist")
    parser.add_argument("--episodes", type=int, default=100, help="of a manifest that is made")
    parser.add_argument("--budget", type=int, default=100, help="of a manifest that is made")
    parser.add_argument("--policy", default="cem")
    parser.add_argument("--references", nargs="*", default=["random", "no_op"])
    parser.add_argument("--parts", type=int, default=8)
    parser.add_argument("--out", type=Path, default=Path("result"))
    parser.add_argument("--cluster", default=None, help="slurm, local, or what submitit finds")
    parser.add_argument("--partition", default=None)
    parser.add_argument("--minutes", type=int, default=60, help="time limit of a job")
    parser.add_argument("--cpus", type=int, default=4)
    options = parser.parse_args()

    if not options.task.exists():
        swm.make_manifest(options.task, options.env, episodes=options.episodes, budget=options.budget)
    executor = submitit.AutoExecutor(folder=str(options.out / "jobs"), cluster=options.cluster)
    executor.update_parameters(timeout_min=options.minutes, cpus_per_task=options.cpus, name="swm")
    if options.partition is not None:
        executor.update_parameters(slurm_partition=options.partition)
    task, out = str(options.task.resolve()), str(options.out.resolve())
    indices = range(1, options.parts + 1)
    jobs = [executor.submit(part, task, options.policy, out, index, options.parts, options.references) for index in indices]
    for job in jobs:
        print(f"part {job.result()} of {options.parts} is done", flush=True)
    print(swm.evaluate(task, options.policy, out, references=options.references, join=True, progress=False))


if __name__ == "__main__":
    main()

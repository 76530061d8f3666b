"""Measures the planning solvers of the Python reference, inside the virtual environment of solvers.py.

Not started by hand: solvers.py starts it once and sends the CPU time per solver, one line per round; each
answer is one line, `{"cem": [seconds, ...], ...}`: the CPU time of every plan made.
"""

import contextlib
import json
import os
import sys
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import gymnasium as gym  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from stable_worldmodel.policy import PlanConfig  # noqa: E402
from stable_worldmodel.solver import (  # noqa: E402
    CategoricalCEMSolver,
    CEMSolver,
    GradientSolver,
    ICEMSolver,
    LagrangianSolver,
    MPPISolver,
    PGDSolver,
    PredictiveSamplingSolver,
)

torch.set_num_threads(1)

SAMPLES, ITERATIONS, HORIZON = 300, 30, 10
BOX = gym.spaces.Box(-1, 1, (1, 2), dtype=np.float32)
FIVE = gym.spaces.Discrete(5)


class FreeCost:
    """The distance of a plan's first number from a half, as on the other side."""

    def get_cost(self, info, candidates):
        return (candidates[:, :, 0, 0] - 0.5).abs()


def cases():
    """By the names of the other side: solver and the actions that it plans."""
    cost, sampled = FreeCost(), {"num_samples": SAMPLES, "n_steps": ITERATIONS}

    def descent(optimizer, lr):
        return GradientSolver(cost, **sampled, optimizer_cls=optimizer, optimizer_kwargs={"lr": lr})

    return {
        "cem": (CEMSolver(cost, **sampled), BOX),
        "icem": (ICEMSolver(cost, **sampled), BOX),
        "mppi": (MPPISolver(cost, **sampled), BOX),
        "predictive-sampling": (PredictiveSamplingSolver(cost, num_samples=SAMPLES), BOX),
        "categorical-cem": (CategoricalCEMSolver(cost, **sampled), FIVE),
        "sgd": (descent(torch.optim.SGD, 0.1), BOX),
        "adam": (descent(torch.optim.Adam, 0.1), BOX),
        "adamw": (descent(torch.optim.AdamW, 0.1), BOX),
        "pgd": (PGDSolver(cost, **sampled), FIVE),
        "lagrangian": (LagrangianSolver(cost, **sampled, optimizer_kwargs={"lr": 0.1}), BOX),
    }


def measure(solver, seconds):
    info = {"state": torch.zeros(1, 1)}
    times = []
    while sum(times) < seconds or len(times) < 5:
        start = time.process_time()
        solver.solve(dict(info))
        times.append(time.process_time() - start)
    return times


def main():
    # The reference prints as it plans; answers go to the stream that solvers.py reads.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    config = PlanConfig(horizon=HORIZON, receding_horizon=HORIZON, action_block=1)
    all_cases = cases()
    for solver, space in all_cases.values():
        solver.configure(action_space=space, n_envs=1, config=config)
    for line in sys.stdin:
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
            times = {name: measure(solver, float(line)) for name, (solver, _) in all_cases.items()}
        print(json.dumps(times), file=answers, flush=True)


if __name__ == "__main__":
    main()

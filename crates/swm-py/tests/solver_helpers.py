"""A NumPy cost, and solvers that are configured."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from stable_worldmodel_rs import PlanConfig

BOX = gym.spaces.Box(-1, 1, (4, 2), np.float32)
# Tests of solvers compare what they search with what costs are given.
CONFIG = PlanConfig(horizon=3, receding_horizon=2, action_block=2, clip_actions=False)


class Sum:
    """Plans should add up to 2."""

    array_api = "numpy"

    def __init__(self):
        self.seen = []

    def get_cost(self, info, candidates):
        self.seen.append(candidates)
        return (candidates.sum(axis=(2, 3)) - 2.0) ** 2

    def get_cost_and_gradient(self, info, candidates):
        costs = self.get_cost(info, candidates)
        slope = 2 * (candidates.sum(axis=(2, 3)) - 2.0)
        return costs, np.broadcast_to(slope[..., None, None], candidates.shape)


def configured(solver, space=BOX, n_envs=4, config=CONFIG):
    solver.configure(action_space=space, n_envs=n_envs, config=config)
    return solver


def info(rows=4):
    return {"state": np.zeros((rows, 1, 5))}

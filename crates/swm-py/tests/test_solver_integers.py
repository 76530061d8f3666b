"""Plans of integers."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from solver_helpers import configured, info
from stable_worldmodel_rs.planning import CategoricalCEMSolver, PGDSolver


class Favor:
    """One category is the best everywhere."""

    array_api = "numpy"

    def __init__(self, target, count):
        self.target, self.count = target, count

    def get_cost(self, info, candidates):
        return -candidates.reshape(*candidates.shape[:3], -1, self.count)[..., self.target].sum(axis=(2, 3))

    def get_cost_and_gradient(self, info, candidates):
        gradient = np.zeros_like(candidates)
        gradient.reshape(*candidates.shape[:3], -1, self.count)[..., self.target] = -1
        return self.get_cost(info, candidates), gradient


@pytest.mark.parametrize("start", [0, 3])
def test_integers_are_planned_by_category(start):
    space = gym.spaces.Discrete(4, start=start)
    solver = configured(CategoricalCEMSolver(Favor(2, 4), n_steps=10, num_samples=64, topk=8), space)
    result = solver.solve(info())
    assert result["actions"].shape == (4, 3, 2) and result["actions"].dtype == np.int64
    assert (result["actions"] == 2 + start).all()
    assert result["costs"] == [-6.0] * 4
    (probs,) = result["probs"]
    assert probs.shape == (4, 3, 2, 4)
    np.testing.assert_allclose(probs.sum(-1), 1.0, rtol=1e-5)
    descent = configured(PGDSolver(Favor(1, 4), n_steps=5, num_samples=2), space)
    assert (descent.solve(info())["actions"] == 1 + start).all()


def test_a_batch_of_integers_is_planned_as_one_action():
    batched = gym.vector.utils.batch_space(gym.spaces.Discrete(4), 3)
    solver = configured(CategoricalCEMSolver(Favor(0, 4), n_steps=5, num_samples=32, topk=4), batched, n_envs=3)
    assert solver.solve(info(3))["actions"].shape == (3, 3, 2)
    several = gym.vector.utils.batch_space(gym.spaces.MultiDiscrete([2, 3]), 3)
    solver = configured(CategoricalCEMSolver(Favor(0, 5), n_steps=5, num_samples=32, topk=4), several, n_envs=3)
    actions = solver.solve(info(3))["actions"]
    # Two integers per action, two actions per block; the first category of the first is favored.
    assert actions.shape == (3, 3, 4) and (actions[..., ::2] == 0).all()
    assert set(np.unique(actions[..., 1::2])) <= {0, 1, 2}


def test_rounded_plans_are_compared_on_request():
    class Mixture:
        """Half of each is best before rounding; after it, category 1."""

        array_api = "numpy"

        def get_cost(self, info, candidates):
            p = candidates.reshape(*candidates.shape[:3], -1, 2)
            return ((p - 0.5) ** 2).sum(axis=(2, 3, 4)) + 0.1 * p[..., 0].sum(axis=(2, 3))

        def get_cost_and_gradient(self, info, candidates):
            p = candidates.reshape(*candidates.shape[:3], -1, 2)
            gradient = 2 * (p - 0.5)
            gradient[..., 0] += 0.1
            return self.get_cost(info, candidates), gradient.reshape(candidates.shape)

    space = gym.spaces.Discrete(2)
    for select in ("relaxed", "rounded"):
        solver = configured(PGDSolver(Mixture(), 20, num_samples=20, lr=0.1, select=select), space)
        result = solver.solve(info())
        assert (result["actions"] == 1).all()
        # Six integers: rounded each costs 0.5, relaxed a little less than 0.05.
        assert result["costs"][0] == pytest.approx(3.0 if select == "rounded" else 6 * 0.04875, abs=1e-3)


def test_integers_warm_start_a_descent():
    solver = configured(PGDSolver(Favor(0, 4), n_steps=0, var_scale=0.0), gym.spaces.Discrete(4), n_envs=1)
    given = np.array([[[3, 1], [2, 2]]])
    result = solver.solve(info(1), init_action=given)
    np.testing.assert_array_equal(result["actions"][:, :2], given)

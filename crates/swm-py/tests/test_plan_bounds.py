"""Plans within the bounds of the actions: what costs are given, what is executed, and what is recorded."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import stable_worldmodel_rs as swm
from stable_worldmodel_rs import MpcPolicy, PlanConfig, WorldModelPolicy
from stable_worldmodel_rs.planning import (
    CEMSolver,
    CMAESSolver,
    FullCEMSolver,
    GradientSolver,
    ICEMSolver,
    LagrangianSolver,
    MPPISolver,
    PredictiveSamplingSolver,
    SimulatorCost,
)
from test_num_envs import Kept

TARGET = np.array([3.0, -0.4])
"""The best action: its first element lies beyond the bound 1."""


class Far:
    """The squared distance of every action to the target; keeps the extremes of what it is given."""

    array_api = "numpy"

    def __init__(self) -> None:
        self.low, self.high = np.full(2, np.inf), np.full(2, -np.inf)

    def _error(self, candidates: Any) -> Any:
        actions = candidates.reshape(*candidates.shape[:2], -1, 2)
        self.low = np.minimum(self.low, actions.min((0, 1, 2)))
        self.high = np.maximum(self.high, actions.max((0, 1, 2)))
        return actions - TARGET

    def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
        return (self._error(candidates) ** 2).sum((2, 3))

    def get_cost_and_gradient(self, infos: dict[str, Any], candidates: Any) -> Any:
        error = self._error(candidates)
        return (error**2).sum((2, 3)), (2 * error).reshape(candidates.shape).astype(np.float32)


SMALL: dict[str, Any] = {"num_samples": 64, "n_steps": 8}
SOLVERS = {
    "CEMSolver": lambda cost: CEMSolver(cost, topk=8, **SMALL),
    "ICEMSolver": lambda cost: ICEMSolver(cost, topk=8, **SMALL),
    "FullCEMSolver": lambda cost: FullCEMSolver(cost, topk=16, **SMALL),
    "MPPISolver": lambda cost: MPPISolver(cost, **SMALL),
    "PredictiveSamplingSolver": lambda cost: PredictiveSamplingSolver(cost, num_samples=64),
    "CMAESSolver": lambda cost: CMAESSolver(cost, **SMALL),
    "GradientSolver": lambda cost: GradientSolver(cost, 20, num_samples=2, optimizer_kwargs={"lr": 0.2}),
    "LagrangianSolver": lambda cost: LagrangianSolver(cost, 20, 1, optimizer_kwargs={"lr": 0.2}),
}


def recorded(policy: Any, env: str = "swm/PushT-v1", episodes: int = 2) -> Any:
    """The recorded actions of a policy, ``(rows, 2)``, without the missing ones."""
    kept = Kept()
    with swm.World(env, 2, max_episode_steps=6, add_pixels=False, threads=1) as world:
        world.set_policy(policy)
        world.collect(writer=kept, episodes=episodes, seed=1, progress=False)
    return np.concatenate([episode["action"][:-1] for episode in kept.episodes])


@pytest.mark.parametrize("name", SOLVERS)
def test_candidates_and_actions_are_within_the_bounds(name: str) -> None:
    cost = Far()
    actions = recorded(WorldModelPolicy(SOLVERS[name](cost), PlanConfig(horizon=2, receding_horizon=1)))
    assert actions.dtype == np.float32 and np.abs(actions).max() <= 1
    assert (cost.low >= -1).all() and (cost.high <= 1).all() and cost.high[0] == 1
    assert (actions[:, 0] > 0.5).all()


def test_the_reference_scores_and_executes_what_it_sampled() -> None:
    cost = Far()
    policy = WorldModelPolicy(SOLVERS["CEMSolver"](cost), PlanConfig(horizon=2, receding_horizon=1, clip_actions=False))
    actions = recorded(policy)
    assert cost.high[0] > 2 and actions[:, 0].max() > 2
    assert "clip_actions=False" in policy.describe()
    clipped = WorldModelPolicy(SOLVERS["CEMSolver"](Far()), PlanConfig(horizon=2, receding_horizon=1))
    assert "clip_actions=True" in clipped.describe()


class Linear:
    """A scaling as scikit-learn has them."""

    def __init__(self, center: Any, scale: Any) -> None:
        self.center, self.scale = np.asarray(center, np.float64), np.asarray(scale, np.float64)

    def transform(self, values: Any) -> Any:
        return (values - self.center) / self.scale

    def inverse_transform(self, values: Any) -> Any:
        return values * self.scale + self.center


@pytest.mark.parametrize("scale", [(0.1, 0.1), (7.0, 0.3), (-0.3, 0.7)])
def test_bounds_are_those_of_plans_in_other_units(scale: tuple[float, float]) -> None:
    scaler = Linear([0.03, -0.01], scale)
    for clip in (False, True):
        cost = Far()
        solver = CEMSolver(cost, num_samples=64, n_steps=4, topk=8, var_scale=20.0, clip=clip)
        actions = recorded(WorldModelPolicy(solver, PlanConfig(horizon=2, receding_horizon=1), process={"action": scaler}))
        ends = scaler.transform(np.array([[-1.0, -1.0], [1.0, 1.0]]))
        low, high = ends.min(0), ends.max(0)
        np.testing.assert_allclose([cost.low, cost.high], [low, high], rtol=1e-5, atol=1e-6)
        assert np.abs(actions).max() <= 1


def test_a_scaling_that_mixes_elements_has_no_bounds() -> None:
    class Turned(Linear):
        def transform(self, values: Any) -> Any:
            return values @ np.array([[0.6, -0.8], [0.8, 0.6]])

    config = PlanConfig(horizon=2, receding_horizon=1)
    with pytest.raises(ValueError, match=r"Turned in process\['action'\] mixes.*clip_actions=False"):
        recorded(WorldModelPolicy(CEMSolver(Far()), config, process={"action": Turned([0, 0], [1, 1])}))


def test_spaces_with_open_ends_and_of_64_bit() -> None:
    cost = Far()
    solver = CEMSolver(cost, num_samples=64, n_steps=8, topk=8)
    policy = WorldModelPolicy(solver, PlanConfig(horizon=1, receding_horizon=1), process={"action": Linear([0, 0], [2, 2])})
    single = gym.spaces.Box(np.array([-np.inf, -0.1]), np.array([np.inf, 0.1]), dtype=np.float64)

    class Envs:
        num_envs = 1
        single_action_space = single
        action_space = gym.vector.utils.batch_space(single, 1)

    policy.set_env(Envs())
    action = policy.get_action({"state": np.zeros((1, 1, 2))})
    assert cost.high[0] > 1 and single.contains(action[0].astype(np.float64)), action


def test_a_solver_alone_clips_as_its_configuration_says() -> None:
    for clips in (True, False):
        cost = Far()
        solver = SOLVERS["CEMSolver"](cost)
        config = PlanConfig(horizon=2, receding_horizon=1, clip_actions=clips)
        solver.configure(action_space=gym.spaces.Box(-1, 1, (3, 2), np.float32), n_envs=3, config=config)
        found = solver.solve({"state": np.zeros((3, 1))})
        assert (np.abs(found["actions"]).max() <= 1) == clips == ("unclipped" in found) == bool(cost.high[0] <= 1)


def test_planners_in_rust_take_the_setting_too() -> None:
    solver = CEMSolver(SimulatorCost(), num_samples=16, n_steps=2, topk=4)
    free = MpcPolicy(solver, config=PlanConfig(horizon=2, receding_horizon=1, clip_actions=False))
    assert "clip_actions=false" in free.text and "clip_actions" not in MpcPolicy(solver, config=PlanConfig(2, 1)).text
    assert "clip_actions=false" in MpcPolicy(solver, config=PlanConfig(2, 1), clip_actions=False).text


def test_a_solver_of_others_is_clipped_where_it_executes() -> None:
    class Others:
        def configure(self, *, action_space: Any, n_envs: int, config: Any) -> None:
            self.action_dim, self.n_envs, self.horizon = 2, n_envs, config.horizon

        def solve(self, info_dict: dict[str, Any], init_action: Any = None) -> dict[str, Any]:
            return {"actions": np.full((len(info_dict["state"]), self.horizon, 2), 5.0, np.float32)}

        __call__ = solve
        array_api = "numpy"

    np.testing.assert_array_equal(recorded(WorldModelPolicy(Others(), PlanConfig(2, 1))), 1.0)


@pytest.mark.parametrize("returned", [np.complex64, "U3", object])
def test_costs_that_are_no_real_numbers_are_refused(returned: Any) -> None:
    class Wrong:
        array_api = "numpy"

        def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
            return np.zeros(candidates.shape[:2]).astype(returned)

    with pytest.raises(swm.PlanError, match="return real numbers"):
        recorded(WorldModelPolicy(CEMSolver(Wrong()), PlanConfig(2, 1)))

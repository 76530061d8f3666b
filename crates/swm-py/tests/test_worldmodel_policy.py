"""Planning policies in Worlds, and the history that models are given. Needs no torch, but where it says so."""

from __future__ import annotations

import json
import subprocess
import sys
from types import SimpleNamespace
from unittest.mock import MagicMock

import gymnasium as gym
import numpy as np
import pytest
import stable_worldmodel_rs as swm
from solver_helpers import Sum
from stable_worldmodel_rs import HistoryBuffer, MpcPolicy, PlanConfig, PlanError, WorldModelPolicy
from stable_worldmodel_rs.planning import CEMSolver, SimulatorCost
from stable_worldmodel_rs.world import World


class Reach:
    """The pusher should be where the goal says; an action moves it by about 100 pixels per second."""

    array_api = "numpy"

    def __init__(self):
        self.rows = []

    def get_cost(self, info, candidates):
        self.rows.append(candidates.shape[0])
        steps = candidates.reshape(*candidates.shape[:2], -1, 2)
        ends = info["state"][..., -1, :2] + 10 * steps.sum(2)
        return ((ends - info["goal_state"][..., -1, :2]) ** 2).sum(-1)


def planner(**changes):
    settings = {"num_samples": 32, "n_steps": 3, "topk": 6, "batch_size": 8} | changes
    return CEMSolver(Reach(), **settings)


def pusht(num_envs, **options):
    return World("swm/PushT-v1", num_envs, None, 15, add_pixels=False, threads=1, **options)


def test_a_world_is_planned_in():
    world, solver = pusht(3), planner()
    config = PlanConfig(horizon=3, receding_horizon=2, action_block=2)
    world.set_policy(WorldModelPolicy(solver, config))
    result = world.evaluate(episodes=4, seed=1)
    assert result["episodes"] == 4
    assert "WorldModelPolicy(CEMSolver, Reach, horizon=3, receding_horizon=2, action_block=2, clip_actions=True)" in repr(result)
    # Three environments side by side, planned for every 4 of 15 steps; then the fourth episode alone.
    assert solver.cost.rows == [3] * 12 + [1] * 12


def test_actions_do_not_depend_on_the_environments_beside():
    def returns(num_envs, batch_size):
        world = pusht(num_envs)
        config = PlanConfig(horizon=3, receding_horizon=2, action_block=2)
        world.set_policy(WorldModelPolicy(planner(batch_size=batch_size), config))
        return world.evaluate(episodes=4, seed=5)["episode_returns"]

    np.testing.assert_array_equal(returns(1, 1), returns(4, 3))


def by_hand(policy, world, steps, seed=0):
    world.set_policy(policy)
    world.reset(seed=seed)
    actions = []
    for _ in range(steps):
        world.step()
        actions.append(world.infos["action"][:, 0].copy())
    return np.stack(actions, 1)


def test_plans_are_executed_block_by_block_and_warm_start_the_next():
    class Keep(Reach):
        def __init__(self):
            super().__init__()
            self.firsts = []

        def get_cost(self, info, candidates):
            self.firsts.append(candidates[0, 0].copy())
            return super().get_cost(info, candidates)

    solver = CEMSolver(Keep(), num_samples=32, n_steps=3, topk=6)
    plans = []
    solve = solver.solve
    solver.solve = lambda *args, **kwargs: plans.append(solve(*args, **kwargs)) or plans[-1]
    policy = WorldModelPolicy(solver, PlanConfig(horizon=4, receding_horizon=1, action_block=3))
    taken = by_hand(policy, pusht(1), 6)
    assert len(plans) == 2
    expected = np.concatenate([plan["actions"][0, 0].reshape(3, 2) for plan in plans])
    np.testing.assert_array_equal(taken[0], expected)
    # The second search begins with the rest of the first plan; zeros follow.
    rest = plans[0]["actions"][0, 1:]
    np.testing.assert_array_equal(solver.cost.firsts[3], np.concatenate([rest, np.zeros((1, 6), np.float32)]))
    assert policy._plans == [2]
    cold = WorldModelPolicy(planner(), PlanConfig(horizon=4, receding_horizon=1, warm_start=False))
    by_hand(cold, pusht(1), 2)
    assert cold._next_init is None


def test_the_plan_is_keyed_by_episode_and_count():
    """The noise of a policy's plans is that of `MpcPolicy` in Rust: seed of the episode, plans it had before."""
    seen = []
    solver = planner(seed=3)
    solve = solver.solve
    solver.solve = lambda *args, **kwargs: seen.append(kwargs["keys"]) or solve(*args, **kwargs)
    world = pusht(2)
    by_hand(WorldModelPolicy(solver, PlanConfig(horizon=2, receding_horizon=1, action_block=2)), world, 4)
    seeds = [int(seed) for seed in world.infos["seed"].reshape(-1)]
    assert [tuple(keys) for keys in seen] == [([0, 1], seeds, [0, 0]), ([0, 1], seeds, [1, 1])]


def test_solvers_of_the_user():
    class Own(CEMSolver):
        def solve(self, info_dict, init_action=None):
            return super().solve({**info_dict, "scalar": np.array(3.0)}, init_action)

    policy = WorldModelPolicy(Own(Reach(), n_steps=1), PlanConfig(horizon=2, receding_horizon=2))
    assert by_hand(policy, pusht(2), 2).shape == (2, 2, 2)


def test_a_reset_forgets_plans():
    world, solver = pusht(2), planner()
    policy = WorldModelPolicy(solver, PlanConfig(horizon=3, receding_horizon=3, action_block=2))
    by_hand(policy, world, 2)
    world.reset(seed=9)
    world.step()
    assert solver.cost.rows == [2] * 6 and policy._plans == [1, 1]


def env(num_envs, space=None):
    single = space or gym.spaces.Box(-1, 1, (2,), np.float32)
    return SimpleNamespace(
        num_envs=num_envs,
        single_action_space=single,
        action_space=gym.vector.utils.batch_space(single, num_envs),
    )


def infos(num_envs, **more):
    return {"state": np.zeros((num_envs, 1, 5)), "goal_state": np.ones((num_envs, 1, 5))} | more


def test_flags_of_begun_and_ended_episodes():
    solver = planner()
    policy = WorldModelPolicy(solver, PlanConfig(horizon=3, receding_horizon=3))
    policy.set_env(env(3))
    policy.get_action(infos(3))
    info = infos(3, _needs_flush=np.array([False, True, False]), terminated=np.array([[False], [False], [True]]))
    actions = policy.get_action(info)
    assert "_needs_flush" not in info
    assert solver.cost.rows == [3, 3, 3, 1, 1, 1]
    assert np.isfinite(actions[:2]).all() and np.isnan(actions[2]).all()
    actions = policy.get_action(infos(3, truncated=np.array([True, True, True])))
    assert np.isnan(actions).all() and solver.cost.rows[6:] == []


def test_scalers_are_inverted_and_applied():
    class Scaler:
        n_features_in_ = 2

        def transform(self, x):
            assert x.ndim == 2 and x.shape[1] == 2
            return (x - 5) / 10

        def inverse_transform(self, x):
            return x * 10 + 5

    class Look(Sum):
        def get_cost(self, info, candidates):
            np.testing.assert_allclose(info["xy"], -0.5)
            np.testing.assert_allclose(info["blocks"], -0.5)
            return super().get_cost(info, candidates)

    policy = WorldModelPolicy(
        CEMSolver(Look(), n_steps=1, num_samples=16, topk=4),
        PlanConfig(horizon=1, receding_horizon=1),
        process={"action": Scaler(), "xy": Scaler(), "blocks": Scaler()},
    )
    policy.set_env(env(1))
    given = {"xy": np.zeros((1, 1, 2)), "blocks": np.zeros((1, 3, 4))}
    planned = []
    solve = policy.solver.solve
    policy.solver.solve = lambda *args, **kwargs: planned.append(solve(*args, **kwargs)) or planned[-1]
    actions = policy.get_action(given)
    np.testing.assert_allclose(actions, planned[0]["actions"][:, 0] * 10 + 5, rtol=1e-6)
    with pytest.raises(ValueError, match="Expected numpy array for key 'xy'"):
        policy._prepare_info({"xy": [1.0]})


def test_a_numpy_cost_is_given_transformed_images_as_arrays():
    pytest.importorskip("torch")

    class Look(Sum):
        def get_cost(self, info, candidates):
            assert isinstance(info["pixels"], np.ndarray)
            assert info["pixels"].shape == (1, candidates.shape[1], 1, 3, 8, 8) and info["pixels"].max() == 1.0
            return super().get_cost(info, candidates)

    policy = WorldModelPolicy(
        CEMSolver(Look(), n_steps=1, num_samples=16, topk=4),
        PlanConfig(horizon=1, receding_horizon=1),
        transform={"pixels": lambda image: image.float() / 255},
    )
    policy.set_env(env(1))
    policy.get_action({"pixels": np.full((1, 1, 8, 8, 3), 255, np.uint8)})


def test_integers_are_executed():
    from stable_worldmodel_rs.planning import CategoricalCEMSolver
    from test_solver_integers import Favor

    for space in (gym.spaces.Discrete(4), gym.spaces.MultiDiscrete([4])):
        solver = CategoricalCEMSolver(Favor(3, 4), n_steps=6, num_samples=64, topk=6)
        policy = WorldModelPolicy(solver, PlanConfig(horizon=3, receding_horizon=1, action_block=2))
        policy.set_env(env(2, space))
        actions = policy.get_action(infos(2))
        assert actions.dtype == np.int64 and actions.shape == (2, *space.shape) and (actions == 3).all()
        over = policy.get_action(infos(2, terminated=np.array([True, False])))
        assert over[0] == 0 and over[1] == 3


def test_a_discrete_world_is_planned_in():
    from stable_worldmodel_rs.planning import CategoricalCEMSolver

    world = World("swm/PushT-Discrete-v1", 2, None, 10, add_pixels=False, threads=1)
    single = world.envs.single_action_space
    count = int(np.sum(single.nvec)) if isinstance(single, gym.spaces.MultiDiscrete) else int(single.n)

    class First:
        array_api = "numpy"

        def get_cost(self, info, candidates):
            assert candidates.shape[-1] == 2 * count
            return -candidates[..., 0].sum(axis=2)

    solver = CategoricalCEMSolver(First(), n_steps=4, num_samples=64, topk=6)
    world.set_policy(WorldModelPolicy(solver, PlanConfig(horizon=2, receding_horizon=2, action_block=2)))
    assert world.evaluate(episodes=2, seed=0)["episodes"] == 2


def test_models_are_given_a_history():
    class Look(Reach):
        seen = []

        def get_cost(self, info, candidates):
            self.seen.append((info["state"][0, 0, :, 0].tolist(), info.get("action_history")))
            return super().get_cost(info, candidates)

    policy = WorldModelPolicy(
        CEMSolver(Look(), n_steps=1, num_samples=16, topk=4),
        PlanConfig(horizon=2, receding_horizon=1, history_len=3, action_block=2),
        history_keys=("state",),
    )
    policy.set_env(env(1))
    action, taken = np.full((1, 2), np.nan, np.float32), []
    for step in range(7):
        state = np.full((1, 1, 5), float(step))
        action = policy.get_action(infos(1, state=state, action=action[:, None]))
        taken.append(action[0])
    assert [frames for frames, _ in Look.seen] == [[0], [0, 2], [0, 2, 4], [2, 4, 6]]
    assert Look.seen[0][1] is None
    np.testing.assert_array_equal(Look.seen[3][1][0, 0], np.array(taken[2:6]).reshape(2, 4))


TEXT = "cem:samples=12,iterations=2,elites=4,aggregate=mean,horizon=2,receding_horizon=2,action_block=2"


def test_planners_in_rust():
    solver = CEMSolver(SimulatorCost(aggregate="mean"), num_samples=12, n_steps=2, topk=4, seed=0)
    policy = MpcPolicy(solver, config=PlanConfig(horizon=2, receding_horizon=2, action_block=2))
    world = World("swm/PointMaze-v0", 2, None, 12, add_pixels=False, threads=1)
    returns = []
    for one in (policy, TEXT, "cem:samples=12,iterations=2,elites=4,seed=1"):
        world.set_policy(one)
        returns.append(world.evaluate(episodes=3, seed=4)["episode_returns"])
    np.testing.assert_array_equal(returns[0], returns[1])
    assert not np.array_equal(returns[0], returns[2])
    assert repr(policy).startswith("MpcPolicy('cem:seed=0,samples=12,iterations=2,elites=4")
    assert MpcPolicy("cem:samples=9", SimulatorCost(success_bonus=0.0)).text == "cem:samples=9,success_bonus=0.0"
    with pytest.raises(PlanError, match="Reach is a Python object; use WorldModelPolicy"):
        MpcPolicy(planner())


def test_a_planner_in_rust_is_that_of_the_command():
    policy = MpcPolicy(
        CEMSolver(SimulatorCost(aggregate="mean"), num_samples=12, n_steps=2, topk=4, seed=0),
        config=PlanConfig(horizon=2, receding_horizon=2, action_block=2),
    )
    world = World("swm/PointMaze-v0", 2, None, 12, add_pixels=False, threads=1)
    world.set_policy(policy)
    ours = world.evaluate(episodes=3, seed=4)
    arguments = ["eval", "swm/PointMaze-v0", "--policy", TEXT, "--episodes", "3", "--seed", "4", "--budget", "12"]
    called = [sys.executable, "-m", "stable_worldmodel_rs", *arguments, "--json"]
    done = subprocess.run(called, capture_output=True, text=True, check=True)
    theirs = json.loads(done.stdout)
    np.testing.assert_array_equal(ours["episode_returns"], theirs["episode_returns"])


def test_plan_configs():
    config = PlanConfig(10, 5, action_block=2)
    assert config.plan_len == 20 and config.warm_start
    with pytest.raises(AttributeError):
        config.horizon = 3
    with pytest.raises(ValueError, match="history_len must be >= 1, got 0"):
        PlanConfig(10, 5, history_len=0)
    with pytest.raises(ValueError, match="receding_horizon is 6, and a plan has 5 blocks"):
        PlanConfig(5, 6)


def test_policies_without_an_environment():
    with pytest.raises(TypeError, match="set_policy"):
        WorldModelPolicy(planner(), PlanConfig(2, 2)).get_action({})
    with pytest.raises(TypeError, match="no solver"):
        WorldModelPolicy(SimpleNamespace(configure=lambda **kwargs: None), PlanConfig(2, 2)).set_env(env(1))
    assert swm.policy.Policy is swm.BasePolicy


def test_the_random_policy_is_seeded():
    def actions(seed):
        policy = swm.RandomPolicy(seed)
        policy.set_env(env(2))
        return policy.get_action({})

    np.testing.assert_array_equal(actions(4), actions(4))
    assert not np.array_equal(actions(4), actions(5))


def test_histories_copy_and_pad():
    buffer = HistoryBuffer(n_envs=2, max_len=5, action_block=2, block_keys=("action",))
    state = np.zeros((2, 1, 1))
    for step in range(4):
        state[:] = step
        buffer.append({"state": state, "action": np.full((2, 1, 1), step - 1.0 if step else np.nan), "name": "a"})
    buffer.reset([1])
    state[:] = 9
    buffer.append({"state": state, "action": np.full((2, 1, 1), 3.0), "name": "a"})
    assert buffer.num_strided() == [3, 1] and len(buffer) == 1
    history = buffer.get(3)
    np.testing.assert_array_equal(history["state"][..., 0], [[0, 2, 9], [9, 9, 9]])
    np.testing.assert_array_equal(history["action"], [[[0, 1], [2, 3]], [[0, 0], [0, 0]]])
    assert buffer.get(0) is None and "action" not in buffer.get(1)


def test_a_network_acts_at_once():
    torch = pytest.importorskip("torch")

    class Net(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.linear = torch.nn.Linear(3 * 16, 2)

        def get_action(self, info):
            assert not self.training and not torch.is_grad_enabled()
            assert torch.equal(info["goal_pixels"], info["goal"])
            return self.linear(info["pixels"].flatten(1))

    def transform(image):
        assert image.shape == (3, 4, 4)
        return image.float() / 255

    policy = swm.FeedForwardPolicy(Net(), transform={"pixels": transform})
    policy.set_env(env(2))
    images = np.full((2, 1, 4, 4, 3), 255, np.uint8)
    action = policy.get_action({"pixels": images, "goal": images, "env_name": ["a", "b"]})
    assert isinstance(action, np.ndarray) and action.shape == (2, 2)
    # A mock of an environment has any attribute, and no shape.
    policy.set_env(MagicMock())
    assert policy.get_action({"pixels": images, "goal": images}).shape == (2, 2)
    with pytest.raises(AssertionError, match="'goal' must be provided"):
        policy.get_action({"pixels": images})
    policy = swm.FeedForwardPolicy(Net(), transform={"pixel": transform})
    policy.set_env(env(2))
    with pytest.raises(ValueError, match="transform names 'pixel', which is no column .did you mean 'pixels'"):
        policy.get_action({"pixels": images, "goal": images})


def test_a_torch_model_plans_in_a_world():
    torch = pytest.importorskip("torch")

    class TorchReach(torch.nn.Module):
        def get_cost(self, info, candidates):
            assert info["pixels"].shape[2:] == (1, 3, 8, 8)
            steps = candidates.reshape(*candidates.shape[:2], -1, 2)
            ends = info["state"][..., -1, :2] + 10 * steps.sum(2)
            return ((ends - info["goal_state"][..., -1, :2]) ** 2).sum(-1)

    world = World("swm/PushT-v1", 2, (8, 8), 6, threads=1)
    solver = CEMSolver(TorchReach(), batch_size=2, num_samples=16, n_steps=2, topk=4)
    policy = WorldModelPolicy(solver, PlanConfig(2, 2), transform={"pixels": lambda image: image.float() / 255})
    world.set_policy(policy)
    assert world.evaluate(episodes=3, seed=0)["episodes"] == 3
    assert torch.is_tensor(policy._next_init) is False  # Nothing is left of plans that are executed whole.

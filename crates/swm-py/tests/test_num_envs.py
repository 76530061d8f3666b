"""Episodes are the same bits for any number of environments: of every planner in Python, and of every policy that the package runs.

A model rounds by the size of its batch. With `batch_size=1` that size is always one, and the bits are the same whatever the
model computes. With a larger one they are where it computes each row by itself, as the costs of this file do; a matrix product
may round another way.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import stable_worldmodel_rs as swm
from stable_worldmodel_rs import PlanConfig, WorldModelPolicy
from stable_worldmodel_rs.planning import (
    CategoricalCEMSolver,
    CEMSolver,
    CMAESSolver,
    FullCEMSolver,
    GradientSolver,
    ICEMSolver,
    LagrangianSolver,
    MPPISolver,
    PGDSolver,
    PredictiveSamplingSolver,
    SimulatorCost,
)
from stable_worldmodel_rs.world import World

COUNTS = (3, 16)
"""Environments that are compared with one."""


class Kept:
    """Keeps recorded episodes."""

    def __init__(self) -> None:
        self.episodes: list[dict[str, Any]] = []

    def write_episodes(self, episodes: Any) -> None:
        self.episodes.extend({name: np.array(values) for name, values in episode.items()} for episode in episodes)


def near(episodes: int) -> list[dict[str, Any]]:
    """Goals so near that an episode ends early, and at some step or other, whoever acts."""
    starts = [{"state": [60.0, 112.0]}] * episodes
    return [{"start": start, "goal": {"state": [77.0 + 3 * (at % 3), 112.0]}} for at, start in enumerate(starts)]


def episodes_of(
    policy: Any, num_envs: int, env: Any = "swm/TwoRoom-v2", episodes: int = 18, begin: Any = None, **options: Any
) -> list[Any]:
    """What is recorded of a policy."""
    options = {"max_episode_steps": 24, "add_pixels": False, "threads": 1} | options
    if not isinstance(env, str):
        env, options = [env] * num_envs, {"max_episode_steps": options["max_episode_steps"]}
    kept = Kept()
    with World(env, num_envs, **options) as world:
        world.set_policy(policy)
        world.collect(writer=kept, episodes=episodes, seed=3, options=begin, progress=False)
    return kept.episodes


def assert_same(found: list[Any], wanted: list[Any], ignored: tuple[str, ...] = ()) -> None:
    assert len(found) == len(wanted)
    for number, (one, other) in enumerate(zip(found, wanted, strict=True)):
        assert one.keys() == other.keys()
        for name in one.keys() - set(ignored):
            np.testing.assert_array_equal(one[name], other[name], err_msg=f"episode {number}, {name}")


def assert_alone_and_together(make: Any, **options: Any) -> list[Any]:
    """Compares episodes of one environment with those of several; gives the former."""
    alone = episodes_of(make(), 1, **options)
    lengths = {len(episode["action"]) for episode in alone}
    assert len(lengths) > 1, "episodes of one length never meet at different ages"
    for count in COUNTS:
        assert_same(episodes_of(make(), count, **options), alone)
    return alone


class Mean:
    """Distance of where a plan leads, from the mean of all frames, to the goal."""

    array_api = "numpy"

    def __init__(self) -> None:
        self.frames: set[int] = set()

    def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
        error = self._error(infos, candidates)
        return (error * error).sum(-1)

    def get_cost_and_gradient(self, infos: dict[str, Any], candidates: Any) -> Any:
        error = self._error(infos, candidates)
        slope = 10 * np.concatenate([error] * (candidates.shape[3] // 2), axis=-1)
        return (error * error).sum(-1), np.broadcast_to(slope[:, :, None], candidates.shape)

    def _error(self, infos: dict[str, Any], candidates: Any) -> Any:
        self.frames.add(infos["state"].shape[2])
        ahead = 5 * candidates.reshape(*candidates.shape[:2], -1, 2).sum(2)
        error = infos["state"].mean(2) + ahead - infos["goal_state"][:, :, -1]
        if "action_history" in infos:
            blocks = infos["action_history"]
            error = error + blocks.reshape(*blocks.shape[:2], -1, 2).sum(2)
        return error


class TorchMean(Mean):
    array_api = "torch"


def planner(solver: Any, history: int) -> WorldModelPolicy:
    config = PlanConfig(horizon=3, receding_horizon=1, action_block=2, history_len=history)
    return WorldModelPolicy(solver, config, history_keys=("state",))


@pytest.mark.parametrize("batch_size", [1, 8])
@pytest.mark.parametrize("history", [1, 3])
@pytest.mark.parametrize("cost", [Mean, TorchMean])
def test_planners_in_python(cost: Any, history: int, batch_size: int) -> None:
    if cost is TorchMean:
        pytest.importorskip("torch")
    costs: list[Any] = []

    def make() -> WorldModelPolicy:
        costs.append(cost())
        return planner(CEMSolver(costs[-1], batch_size, num_samples=24, n_steps=3, topk=5), history)

    assert_alone_and_together(make)
    assert all(one.frames == set(range(1, history + 1)) for one in costs)


SMALL: dict[str, Any] = {"num_samples": 12, "n_steps": 2}
SOLVERS = {
    "ICEMSolver": lambda: ICEMSolver(Mean(), topk=4, **SMALL),
    "MPPISolver": lambda: MPPISolver(Mean(), **SMALL),
    "PredictiveSamplingSolver": lambda: PredictiveSamplingSolver(Mean(), num_samples=12),
    "CMAESSolver": lambda: CMAESSolver(Mean(), **SMALL),
    "FullCEMSolver": lambda: FullCEMSolver(Mean(), topk=8, num_samples=24, n_steps=2),
    "GradientSolver": lambda: GradientSolver(Mean(), 3, num_samples=2, optimizer_kwargs={"lr": 0.01}),
    "LagrangianSolver": lambda: LagrangianSolver(Mean(), 2, 2, optimizer_kwargs={"lr": 0.05}),
}


@pytest.mark.parametrize("name", SOLVERS)
def test_every_solver(name: str) -> None:
    assert_alone_and_together(lambda: planner(SOLVERS[name](), 3), episodes=9, begin=near(9))


@pytest.mark.parametrize("name", ["CategoricalCEMSolver", "PGDSolver"])
def test_solvers_of_integers(name: str) -> None:
    class Nearer:
        """Whichever category the frames ask for."""

        array_api = "numpy"

        def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
            wanted = (np.floor(infos["state"][..., :2].mean((2, 3))) % 3).astype(int)
            blocks = candidates.sum(2)
            return -np.take_along_axis(blocks, wanted[..., None], 2)[..., 0]

        def get_cost_and_gradient(self, infos: dict[str, Any], candidates: Any) -> Any:
            costs = self.get_cost(infos, candidates)
            return costs, np.full(candidates.shape, 0.1, np.float32)

    def make() -> WorldModelPolicy:
        solver: Any = (
            CategoricalCEMSolver(Nearer(), num_samples=16, n_steps=2, topk=4)
            if name == "CategoricalCEMSolver"
            else PGDSolver(Nearer(), n_steps=2, num_samples=3)
        )
        return planner(solver, 3)

    alone = episodes_of(make(), 1, env="swm/PushT-Discrete-v1", episodes=5)
    for count in (2, 4):
        # Episodes that begin in a run differ in age from those that began before it.
        assert_same(episodes_of(make(), count, env="swm/PushT-Discrete-v1", episodes=5), alone)


def test_a_network_on_images_with_a_history() -> None:
    """Matrix products and convolutions, one environment at a time."""
    torch = pytest.importorskip("torch")

    class Net(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            torch.manual_seed(0)
            self.encoder = torch.nn.Sequential(torch.nn.Conv2d(3, 4, 4, stride=4), torch.nn.Flatten(), torch.nn.Linear(64, 8))
            self.head = torch.nn.Linear(3 * 8 + 12, 1)

        def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
            frames = infos["pixels"][:, 0]
            codes = self.encoder(frames.flatten(0, 1)).reshape(len(frames), -1)
            codes = torch.nn.functional.pad(codes, (0, 24 - codes.shape[1]))
            both = torch.cat([codes[:, None].expand(-1, candidates.shape[1], -1), candidates.flatten(2)], -1)
            return self.head(both)[..., 0]

    def make() -> WorldModelPolicy:
        config = PlanConfig(horizon=3, receding_horizon=1, action_block=2, history_len=3)
        solver = CEMSolver(Net(), num_samples=12, n_steps=2, topk=4)
        return WorldModelPolicy(solver, config, transform={"pixels": lambda image: image.float() / 255})

    assert_alone_and_together(make, episodes=9, begin=near(9), add_pixels=True, image_shape=(16, 16))


def test_a_model_that_proposes_actions() -> None:
    """Its own actions begin the first plan of every episode, also where other episodes are older."""
    torch = pytest.importorskip("torch")

    class Proposes(TorchMean):
        def __init__(self) -> None:
            super().__init__()
            self.asked: list[tuple[int, int]] = []

        def get_action(self, info: Any, horizon: int = 1, prefix_actions: Any = None) -> Any:
            rows = len(info["state"])
            self.asked.append((rows, horizon))
            state = info["state"].reshape(rows, -1)[:, -2:].float() / 500
            return state.repeat(1, 2)[:, None].expand(-1, horizon, -1)

    costs: list[Any] = []

    def make() -> WorldModelPolicy:
        costs.append(Proposes())
        return planner(CEMSolver(costs[-1], num_samples=12, n_steps=2, topk=4), 1)

    assert_alone_and_together(make, episodes=9)
    # Whole plans where an episode begins, the last block of the others; one environment at a time.
    assert all({horizon for _, horizon in one.asked} == {3, 1} and {rows for rows, _ in one.asked} == {1} for one in costs)
    assert torch.is_tensor(torch.zeros(1))


def policies_of(env: str) -> list[str]:
    """The policies of an environment, by name, that act without a file or model."""
    called = [sys.executable, "-m", "stable_worldmodel_rs", "envs", env, "--json"]
    done = subprocess.run(called, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    names = [policy["name"] for policy in found["policies"]]
    return [name for name in names if name not in ("onnx", "replay", "mpc", "policy", "constant")]


SAMPLING = "samples=8,iterations=2,horizon=2,receding_horizon=1,action_block=2"
# Gradients of the simulator are differences of many rollouts.
GRADIENTS = "iterations=1,horizon=1,receding_horizon=1,action_block=1"
PLANNERS: dict[str, str] = {
    "cem": f"elites=3,{SAMPLING}",
    "icem": f"elites=3,elites_kept=1,{SAMPLING}",
    "full-cem": f"elites=3,{SAMPLING}",
    "categorical-cem": f"elites=3,{SAMPLING}",
    "mppi": SAMPLING,
    "cma-es": SAMPLING,
    "predictive-sampling": SAMPLING.replace("iterations=2,", ""),
    "sgd": GRADIENTS,
    "adam": GRADIENTS,
    "adamw": GRADIENTS,
    "pgd": GRADIENTS,
    "lagrangian": f"rounds=1,{GRADIENTS}",
}


@pytest.mark.parametrize("env", ["swm/PushT-v1", "swm/TwoRoom-v2", "swm/PushT-Discrete-v1"])
def test_every_policy_in_rust(env: str) -> None:
    ran: list[str] = []
    for name in policies_of(env):
        settings = f"{name}:{PLANNERS[name]}" if name in PLANNERS else name
        of_run: dict[str, Any] = {"env": env, "episodes": 5, "max_episode_steps": 8}
        try:
            alone = episodes_of(settings, 1, **of_run)
        except swm.SwmError as error:
            # Gradients of integers, and the like: refused alike in every number of environments.
            with pytest.raises(type(error), match=re.escape(str(error))):
                episodes_of(settings, 3, **of_run)
            continue
        ran.append(name)
        for count in COUNTS:
            assert_same(episodes_of(settings, count, **of_run), alone)
    assert {"random", "cem" if "Discrete" not in env else "categorical-cem"} <= set(ran), ran


def toward(infos: dict[str, Any]) -> Any:
    return ((infos["goal_state"] - infos["state"])[:, 0, :2] / 50).clip(-1, 1).astype(np.float32)


def test_other_policies_in_python() -> None:
    assert_alone_and_together(lambda: toward, episodes=9)
    assert_alone_and_together(lambda: swm.RandomPolicy(seed=7), episodes=9, begin=near(9))
    solver = CEMSolver(SimulatorCost(), num_samples=12, n_steps=2, topk=4)
    config = PlanConfig(horizon=2, receding_horizon=1, action_block=2)
    assert_alone_and_together(lambda: swm.MpcPolicy(solver, config=config), episodes=9)


def test_feed_forward_networks() -> None:
    torch = pytest.importorskip("torch")

    class Net(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            torch.manual_seed(0)
            self.layers = torch.nn.Sequential(torch.nn.Linear(4, 64), torch.nn.Tanh(), torch.nn.Linear(64, 2), torch.nn.Tanh())

        def get_action(self, infos: dict[str, Any]) -> Any:
            both = torch.cat([infos["state"], infos["goal_state"]], -1)[:, 0].float()
            return self.layers(both / 224)

    def make() -> swm.FeedForwardPolicy:
        return swm.FeedForwardPolicy(Net(), batch_size=1)

    alone = episodes_of(make(), 1, episodes=9, image_shape=(16, 16), add_pixels=True)
    for count in COUNTS:
        assert_same(episodes_of(make(), count, episodes=9, image_shape=(16, 16), add_pixels=True), alone)
    with pytest.raises(ValueError, match="batch_size must be >= 1"):
        swm.FeedForwardPolicy(Net(), batch_size=0)


class Dot(gym.Env[Any, Any]):
    """An environment of Gymnasium: a dot that is moved, from a random place; near the middle it is done."""

    observation_space = gym.spaces.Dict({"state": gym.spaces.Box(-9, 9, (2,), np.float32)})
    action_space = gym.spaces.Box(-1, 1, (2,), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.at = self.np_random.uniform(-2, 2, 2).astype(np.float32)
        return {"state": self.at.copy()}, {}

    def step(self, action: Any) -> Any:
        self.at = self.at + 0.3 * np.asarray(action, np.float32)
        return {"state": self.at.copy()}, -float(np.linalg.norm(self.at)), bool(np.linalg.norm(self.at) < 0.9), False, {}


class Middle(Mean):
    def _error(self, infos: dict[str, Any], candidates: Any) -> Any:
        self.frames.add(infos["state"].shape[2])
        return infos["state"].mean(2) + 0.3 * candidates.reshape(*candidates.shape[:2], -1, 2).sum(2)


@pytest.mark.parametrize("policy", ["planner", "random"])
def test_environments_of_gymnasium(policy: str) -> None:
    """They are numbered as they begin, and stored in this order: those that end first would be the short ones."""

    def make() -> Any:
        return planner(CEMSolver(Middle(), num_samples=12, n_steps=2, topk=4), 3) if policy == "planner" else "random"

    alone = assert_alone_and_together(make, env=Dot, episodes=8, max_episode_steps=12)
    with World([Dot] * 3, 3, max_episode_steps=12) as world:
        world.set_policy(make())
        found = world.evaluate(episodes=8, seed=3, progress=False)
    assert found["seeds"].tolist() == list(range(3, 11))
    assert found["episode_successes"].tolist() == [bool(episode["terminated"][-1]) for episode in alone]

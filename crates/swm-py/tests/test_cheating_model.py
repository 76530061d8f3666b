"""A model that knows the true dynamics reaches what the planner on the simulator reaches: with a history of three frames, scaled
`proprio` and actions, images, and blocks of five actions; in torch and in NumPy; in any number of environments.

Whatever the platform gives the model wrongly, it answers with an error or plans elsewhere: it begins its rollouts at the oldest
frame, moves through the executed blocks, and compares where it arrives with the present.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from stable_worldmodel_rs import MpcPolicy, PlanConfig, WorldModelPolicy
from stable_worldmodel_rs.planning import CEMSolver, SimulatorCost

ENV = "swm/TwoRoom-v2"
SPEED_PX = 1.75
"""Pixels that a full action moves the agent, far from walls: the slowest that the environment has."""
BLOCK = 5
CONFIG = PlanConfig(horizon=3, receding_horizon=1, action_block=BLOCK, history_len=3)
SETTINGS: dict[str, Any] = {"num_samples": 48, "n_steps": 5, "topk": 6}
COUNTS = (1, 4, 16)
EPISODES, OFFSET, BUDGET = 12, 22, 60


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Walks straight from the middle of a room in many directions, which meet no wall."""
    path = tmp_path_factory.mktemp("cheat") / "walks.h5"
    with swm.World(ENV, 4, image_shape=(16, 16), max_episode_steps=24, threads=1) as world:

        def straight(infos: dict[str, Any]) -> Any:
            angle = 2 * np.pi * (infos["seed"][:, 0] % 997) / 997
            return np.stack([np.cos(angle), np.sin(angle)], 1).astype(np.float32)

        world.set_policy(straight)
        begin = {"variation_values": {"agent.position": [56.0, 112.0], "agent.speed": SPEED_PX}}
        world.collect(path, episodes=12, seed=0, options=begin, progress=False)
    return path


class Dynamics:
    """The true dynamics, in what arrays and tensors both can do."""

    def __init__(self, proprio: Any, action: Any, as_array: Any) -> None:
        self.of_proprio = [as_array(np.asarray(part, np.float32).reshape(2)) for part in (proprio.mean, proprio.std)]
        self.of_action = [as_array(np.asarray(part, np.float32).reshape(2)) for part in (action.mean, action.std)]
        self.frames: list[int] = []

    def actions(self, blocks: Any) -> Any:
        """Scaled blocks ``(B, S, t, D)`` as actions ``(B, S, t × BLOCK, 2)``."""
        mean, std = self.of_action
        actions = blocks.reshape(*blocks.shape[:2], -1, 2) * std + mean
        assert abs(actions).max() <= 1 + 1e-4, "plans, and what was executed, lie within the bounds"
        return actions

    def costs(self, infos: dict[str, Any], candidates: Any) -> Any:
        mean, std = self.of_proprio
        seen = infos["proprio"] * std + mean
        frames = seen.shape[2]
        self.frames.append(frames)
        assert infos["pixels"].shape[2:] == (frames, 3, 16, 16) and infos["pixels"].max() <= 1
        at = seen[:, :, 0]
        if frames > 1:
            executed = self.actions(infos["action_history"])
            assert executed.shape[2] == BLOCK * (frames - 1)
            at = at + SPEED_PX * executed.sum(2)
        assert abs(at - seen[:, :, -1]).max() < 0.05, "from the oldest frame, the executed blocks lead to the present"
        goal = infos["goal_state"][:, :, -1] * std + mean
        steps = self.actions(candidates)
        total = 0.0
        for block in range(candidates.shape[2]):
            at = at + SPEED_PX * steps[:, :, block * BLOCK : (block + 1) * BLOCK].sum(2)
            total = total + ((at - goal) ** 2).sum(-1)
        return total


def model_of(api: str, proprio: Any, action: Any) -> Any:
    if api == "numpy":

        class Model:
            array_api = "numpy"
            dynamics = Dynamics(proprio, action, np.asarray)

            def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
                return self.dynamics.costs(infos, candidates)

        return Model()
    torch = pytest.importorskip("torch")

    class TorchModel(torch.nn.Module):
        dynamics = Dynamics(proprio, action, torch.from_numpy)

        def forward(self, infos: dict[str, Any], candidates: Any) -> Any:
            return self.dynamics.costs(infos, candidates)

        get_cost = forward

    return TorchModel()


def policy_of(api: str, path: Path, batch_size: int) -> WorldModelPolicy:
    data = swm.data.load_dataset(path)
    proprio, action = (swm.data.ZScoreScaler().fit(data.get_col_data(name)) for name in ("proprio", "action"))
    solver = CEMSolver(model_of(api, proprio, action), batch_size, **SETTINGS)
    # `goal_state` is scaled as `state`, and the room calls its position both `state` and `proprio`.
    process = {"action": action, "proprio": proprio, "state": proprio}
    return WorldModelPolicy(solver, CONFIG, process=process, transform={"pixels": scaled})


def scaled(image: Any) -> Any:
    return image.float() / 255


def oracle() -> MpcPolicy:
    return MpcPolicy(CEMSolver(SimulatorCost(aggregate="mean"), **SETTINGS), config=CONFIG)


@pytest.mark.parametrize("batch_size", [1, 8])
@pytest.mark.parametrize("api", ["numpy", "torch"])
def test_it_reaches_the_oracles_result(api: str, batch_size: int, dataset: Path, tmp_path: Path) -> None:
    # Transforms of images take torch tensors, for costs in NumPy, too.
    pytest.importorskip("torch")
    data = swm.data.load_dataset(dataset)

    def evaluated(policy: Any, count: int) -> Any:
        with swm.World(ENV, count, image_shape=(16, 16), threads=1) as world:
            world.set_policy(policy)
            return swm.evaluate_from_dataset(
                world, data, episodes=EPISODES, goal_offset=OFFSET, eval_budget=BUDGET, seed=4
            )

    best = evaluated(oracle(), 4)
    assert best["success_rate"] == 100.0
    steps = []
    for count in COUNTS:
        policy = policy_of(api, dataset, batch_size)
        found = evaluated(policy, count)
        assert found["success_rate"] == 100.0, (count, found)
        assert set(policy.solver.cost.dynamics.frames) == {1, 2, 3}
        steps.append(list(found["episode_lengths"]))
    assert steps[0] == steps[1] == steps[2]
    # On the way as long as the oracle, but for a block.
    assert abs(np.mean(steps[0]) - np.mean(best["episode_lengths"])) < BLOCK

    path = tmp_path / "task.toml"
    swm.make_manifest(
        path, ENV, episodes=EPISODES, dataset=dataset, goal_offset=OFFSET, budget=BUDGET, image_shape=(16, 16), seed=1
    )
    receipts = [
        swm.evaluate(path, policy_of(api, dataset, batch_size), num_envs=count, references=[], progress=False)
        for count in COUNTS
    ]
    assert [receipt.success_rate for receipt in receipts] == [100.0] * 3
    assert receipts[0]["episodes"] == receipts[1]["episodes"] == receipts[2]["episodes"]
    assert all('clip_actions": true' in json.dumps(receipt) for receipt in receipts)
    assert swm.same(receipts[0], receipts[1]) and swm.same(receipts[0], receipts[2])
    again = swm.verify(receipts[0], policy_of(api, dataset, batch_size), num_envs=4, progress=False)
    assert again["equal"], again


def test_without_images_neither_needs_torch(dataset: Path) -> None:
    class NoImages(Dynamics):
        def costs(self, infos: dict[str, Any], candidates: Any) -> Any:
            frames = infos["proprio"].shape[2]
            images = np.zeros((1, 1, frames, 3, 16, 16))
            return super().costs({**infos, "pixels": images}, candidates)

    class Model:
        array_api = "numpy"

        def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
            return self.dynamics.costs(infos, candidates)

    data = swm.data.load_dataset(dataset)
    proprio, action = (swm.data.ZScoreScaler().fit(data.get_col_data(name)) for name in ("proprio", "action"))
    found = []
    for count in COUNTS:
        model = Model()
        model.dynamics = NoImages(proprio, action, np.asarray)
        process = {"action": action, "proprio": proprio, "state": proprio}
        with swm.World(ENV, count, add_pixels=False, threads=1) as world:
            world.set_policy(WorldModelPolicy(CEMSolver(model, **SETTINGS), CONFIG, process=process))
            result = swm.evaluate_from_dataset(
                world, data, episodes=EPISODES, goal_offset=OFFSET, eval_budget=BUDGET, seed=4
            )
        assert result["success_rate"] == 100.0
        found.append(list(result["episode_lengths"]))
    assert found[0] == found[1] == found[2]

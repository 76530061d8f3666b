"""Wrong inputs of a first week, from Python with torch: functions that take a folder of their own and do one wrong thing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import stable_worldmodel_rs as swm
from stable_worldmodel_rs.planning import CEMSolver, GoalMSE, GradientSolver, ShootingCostEvaluator

import torch


class StateCost(torch.nn.Module):
    """A cost of the state that is right, but for what a test changes."""

    def get_cost(self, infos: dict[str, Any], candidates: torch.Tensor) -> torch.Tensor:
        moves = candidates.reshape(*candidates.shape[:2], -1, 2).sum(2)
        return (moves + infos["state"][:, :, -1, :2].float() / 500).pow(2).sum(-1)


class WithDropout(StateCost):
    """In training mode, as a module is when it was made."""

    def __init__(self) -> None:
        super().__init__()
        self.dropout = torch.nn.Dropout(0.5)

    def get_cost(self, infos: dict[str, Any], candidates: torch.Tensor) -> torch.Tensor:
        return super().get_cost(infos, self.dropout(candidates))


class NanCost(StateCost):
    def get_cost(self, infos: dict[str, Any], candidates: torch.Tensor) -> torch.Tensor:
        return super().get_cost(infos, candidates) * float("nan")


class CostWithAxis(StateCost):
    def get_cost(self, infos: dict[str, Any], candidates: torch.Tensor) -> torch.Tensor:
        return super().get_cost(infos, candidates)[..., None]


class CostOfMean(StateCost):
    """One cost for all candidates, as a loss of a training step."""

    def get_cost(self, infos: dict[str, Any], candidates: torch.Tensor) -> torch.Tensor:
        return super().get_cost(infos, candidates).mean()


class CostByArgmin(StateCost):
    """Its derivative is cut."""

    def get_cost(self, infos: dict[str, Any], candidates: torch.Tensor) -> torch.Tensor:
        return super().get_cost(infos, candidates.detach())


class ImageModel(torch.nn.Module):
    """Encodes images, without a transform that makes them channels first and float."""

    def __init__(self) -> None:
        super().__init__()
        self.conv = torch.nn.Conv2d(3, 4, 8, stride=8)

    def encode(self, x: dict[str, Any]) -> dict[str, Any]:
        images = x["pixels"]
        return {**x, "emb": self.conv(images.flatten(0, 1)).flatten(1).unflatten(0, images.shape[:2])}

    def rollout(self, info: dict[str, Any], candidates: torch.Tensor) -> dict[str, Any]:
        seen = self.encode({"pixels": info["pixels"][:, 0]})["emb"]
        info["predicted_emb"] = seen[:, None].expand(-1, candidates.shape[1], -1, -1)
        return info


class WideGoal(ImageModel):
    """Its goal has one value where its predictions have 64: the difference broadcasts."""

    def encode(self, x: dict[str, Any]) -> dict[str, Any]:
        return {**x, "emb": x["state"][:, :, :1].float()}

    def rollout(self, info: dict[str, Any], candidates: torch.Tensor) -> dict[str, Any]:
        info["predicted_emb"] = candidates.repeat(1, 1, 1, 8)
        return info


CONFIG: dict[str, int] = {"horizon": 2, "receding_horizon": 1}


def world(**options: Any) -> swm.World:
    options = {"image_shape": (32, 32), "max_episode_steps": 4, "threads": 1, **options}
    return swm.World("swm/PushT-v1", num_envs=2, **options)


def plan(cost: Any, solver: Any = CEMSolver, config: dict[str, Any] = CONFIG, **options: Any) -> None:
    """An evaluation of two short episodes."""
    if solver is CEMSolver:
        solver = CEMSolver(cost, num_samples=8, n_steps=2, topk=2)
    elif isinstance(solver, type):
        solver = solver(cost, num_samples=2, n_steps=2)
    live = world()
    live.set_policy(swm.WorldModelPolicy(solver, swm.PlanConfig(**config), **options))
    live.evaluate(episodes=2, seed=0)


def act(policy: Any, num_envs: int = 2) -> None:
    live = swm.World("swm/PushT-v1", num_envs=num_envs, add_pixels=False, max_episode_steps=4, threads=1)
    live.set_policy(policy)
    live.evaluate(episodes=2, seed=0)


def scaler(values: Any) -> Any:
    return swm.data.ZScoreScaler().fit(values)


def recording(folder: Path) -> Path:
    path = folder / "pusht.h5"
    live = world(max_episode_steps=10)
    live.set_policy("random")
    live.collect(path, episodes=3, seed=0, progress=False)
    return path


def model_in_training_mode(_: Path) -> None:
    plan(WithDropout())


def costs_of_nan(_: Path) -> None:
    plan(NanCost())


def costs_with_another_axis(_: Path) -> None:
    plan(CostWithAxis())


def one_cost_for_all(_: Path) -> None:
    plan(CostOfMean())


def gradient_of_detached(_: Path) -> None:
    plan(CostByArgmin(), GradientSolver)


def goal_of_another_size(_: Path) -> None:
    plan(ShootingCostEvaluator(WideGoal(), GoalMSE()))


def fractional_horizon(_: Path) -> None:
    plan(StateCost(), config={"horizon": 2.5, "receding_horizon": 1})


def actions_by_column(_: Path) -> None:
    act(lambda infos: torch.zeros(2, 3), num_envs=3)


def flat_actions(_: Path) -> None:
    act(lambda infos: torch.zeros(4))


def actions_of_nan(_: Path) -> None:
    act(lambda infos: torch.full((2, 2), float("nan")))


def more_clips_than_there_are(folder: Path) -> None:
    """An epoch without any batch."""
    batches = list(swm.data.Loader(recording(folder), batch_size=1000, drop_last=True))
    assert batches == []


def loader_of_no_steps(folder: Path) -> None:
    next(iter(swm.data.Loader(recording(folder), batch_size=2, num_steps=0)))


def images_of_torch(folder: Path) -> None:
    """Images as torch has them: f32, channels first, 0 to 1."""
    with swm.data.HDF5Writer(folder / "own.h5") as writer:
        writer.write_episode({"pixels": torch.rand(5, 3, 32, 32), "action": torch.zeros(5, 2)})


def module_without_get_cost(_: Path) -> None:
    plan(torch.nn.Linear(2, 2))


def process_of_actions(_: Path) -> None:
    plan(StateCost(), process={"actions": scaler(np.random.randn(9, 2))})


def transform_of_pixel(_: Path) -> None:
    plan(StateCost(), transform={"pixel": lambda image: image.float() / 255})


def batch_size_zero(_: Path) -> None:
    plan(StateCost(), CEMSolver(StateCost(), batch_size=0, num_samples=8, n_steps=2, topk=2))


def policy_without_get_action(_: Path) -> None:
    act(swm.FeedForwardPolicy(torch.nn.Linear(2, 2)))


def images_without_transform(_: Path) -> None:
    plan(ShootingCostEvaluator(ImageModel(), GoalMSE()))


INPUTS: list[tuple[Callable[[Path], Any], list[str]]] = [
    (model_in_training_mode, ["WithDropout", "training mode", "Dropout", "eval()"]),
    (costs_of_nan, ["all 8 candidates have a cost that is not finite", "check the model"]),
    (costs_with_another_axis, ["CostWithAxis.get_cost", "(1, 8, 1)", "return (1, 8)"]),
    (one_cost_for_all, ["CostOfMean.get_cost", "()", "return (1, 8)"]),
    (gradient_of_detached, ["CostByArgmin", "remove `detach()`"]),
    (goal_of_another_size, ["GoalMSE", "'predicted_emb', (16,)", "'goal_emb', (1,)"]),
    (fractional_horizon, ["horizon must be a whole number, got 2.5"]),
    (actions_by_column, ["shape [3, 2], one row per environment", "found float32 of shape [2, 3]"]),
    (flat_actions, ["shape [2, 2]", "found float32 of shape [4]"]),
    (actions_of_nan, ["environment 0", "the action [NaN, NaN] is not finite"]),
    (more_clips_than_there_are, ["no batch of 1000 is full", "33 clips"]),
    (loader_of_no_steps, ["`num_steps`: 0 rows; use 1 or more"]),
    (images_of_torch, ["column 'pixels' is float32 of shape (3, 32, 32) per step", "images are uint8 (H, W, 3)"]),
    (module_without_get_cost, ["CEMSolver was given Linear, which has no get_cost(info_dict, candidates)"]),
    (process_of_actions, ["process names 'actions', which is no column (did you mean 'action'?)"]),
    (transform_of_pixel, ["transform names 'pixel', which is no column (did you mean 'pixels'?)"]),
    (batch_size_zero, ["batch_size must be >= 1 or None, got 0"]),
    (policy_without_get_action, ["FeedForwardPolicy was given Linear, which has no get_action(info)"]),
    (images_without_transform, ["without a transform, the model is given"]),
]

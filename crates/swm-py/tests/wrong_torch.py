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


class Returned(StateCost):
    """A cost that returns what a function makes of right costs ``(B, S)``."""

    def __init__(self, function: Callable[[torch.Tensor], Any]) -> None:
        super().__init__()
        self.function = function

    def get_cost(self, infos: dict[str, Any], candidates: torch.Tensor) -> Any:
        return self.function(super().get_cost(infos, candidates))


class OfCandidates(StateCost):
    """A cost that is a function of the candidates ``(B, S, H, A)``."""

    def __init__(self, function: Callable[[torch.Tensor], Any]) -> None:
        super().__init__()
        self.function = function

    def get_cost(self, infos: dict[str, Any], candidates: torch.Tensor) -> Any:
        return self.function(candidates)


class NumpyCost:
    array_api = "numpy"

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function = function

    def get_cost(self, infos: dict[str, Any], candidates: Any) -> Any:
        return self.function((candidates**2).sum((2, 3)))


class Frames(StateCost):
    """A model that takes three frames."""

    history_len = 3

    def get_cost(self, infos: dict[str, Any], candidates: torch.Tensor) -> torch.Tensor:
        return super().get_cost(infos, candidates) + infos["state"][:, :, -3:, :2].reshape(*candidates.shape[:2], 6).float().sum(-1)


class Predicts(torch.nn.Module):
    """A world model of states whose prediction a function spoils."""

    def __init__(self, function: Callable[[torch.Tensor], Any]) -> None:
        super().__init__()
        self.function = function

    def rollout(self, info: dict[str, Any], candidates: torch.Tensor) -> dict[str, Any]:
        info["predicted_emb"] = self.function(info["state"][:, :, -1:, :2].float() + candidates.cumsum(2))
        return info


def shooting(function: Callable[[torch.Tensor], Any], objective: Any = None) -> Any:
    return ShootingCostEvaluator(Predicts(function), objective or GoalMSE(), encode_goal=lambda _, info: info["goal_state"][:, 0, :, :2].float())  # type: ignore[arg-type]


def model(function: Callable[[dict[str, Any]], Any]) -> Any:
    """A network that acts at once."""

    class Acts(torch.nn.Module):
        def get_action(self, infos: dict[str, Any]) -> Any:
            return function(infos)

    return Acts()


def feed_forward(function: Callable[[dict[str, Any]], Any]) -> None:
    live = world(goal_conditioned=True)
    live.set_policy(swm.FeedForwardPolicy(model(function)))
    live.evaluate(episodes=2, seed=0)


def on_images(function: Callable[[torch.Tensor], Any]) -> None:
    plan(ShootingCostEvaluator(ImageModel(), GoalMSE()), transform={"pixels": function})


def sizes() -> Callable[[torch.Tensor], torch.Tensor]:
    """A transform whose images grow."""
    seen: list[int] = []

    def crop(image: torch.Tensor) -> torch.Tensor:
        seen.append(1)
        return image[:, : 16 + len(seen)].float()

    return crop


def solver_on(device: str) -> Any:
    return CEMSolver(StateCost(), num_samples=8, n_steps=2, topk=2, device=device)


def in_gradients(function: Callable[[torch.Tensor], Any]) -> None:
    plan(OfCandidates(function), GradientSolver)


def row(name: str, call: Callable[[], Any], *words: str) -> tuple[Callable[[Path], Any], list[str]]:
    """A wrong input by its name."""

    def wrong(_: Path) -> None:
        call()

    wrong.__name__ = name
    return wrong, list(words)


# By what is wrong: what a cost or model returns, where it is, how gradients reach it; what a policy, a transform or a scaler returns.
MORE: list[tuple[Callable[[Path], Any], list[str]]] = [
    row("costs_of_candidates_alone", lambda: plan(Returned(lambda costs: costs[0])), "a tensor [8] of float32 on cpu", "costs [B, S] = [1, 8]", "costs[None]"),
    row("costs_transposed", lambda: plan(Returned(lambda costs: costs.T)), "a tensor [8, 1]", "[B, S] = [1, 8]", "return costs.T"),
    row("costs_by_step", lambda: plan(Returned(lambda costs: costs[..., None].expand(-1, -1, 2))), "[1, 8, 2]", "costs.flatten(2).sum(-1)"),
    row("costs_as_list", lambda: plan(Returned(lambda costs: costs.tolist())), "a list of 1", "expected a torch.Tensor", "torch.stack(values)"),
    row("costs_as_number", lambda: plan(Returned(lambda costs: costs.mean().item())), "returned float", "sum over H and A alone"),
    row("costs_as_none", lambda: plan(Returned(lambda _: None)), "returned None", "end the method with `return`"),
    row("costs_as_array", lambda: plan(Returned(lambda costs: costs.numpy())), "an array [1, 8] of float32", "torch.from_numpy(values)", 'array_api = "numpy"'),
    row("costs_with_more", lambda: plan(Returned(lambda costs: (costs, {}))), "a tuple of 2, the first of them a tensor [1, 8]", "return its first part alone"),
    row("costs_in_a_dict", lambda: plan(Returned(lambda costs: {"loss": costs})), "a dict with loss", "the value of the key that holds the costs"),
    row("costs_complex", lambda: plan(Returned(lambda costs: costs.to(torch.complex64))), "complex64", "return real numbers"),
    row("costs_without_data", lambda: plan(Returned(lambda costs: costs.to("meta"))), "on meta", "device with data"),
    row("array_of_candidates_alone", lambda: plan(NumpyCost(lambda costs: costs[0])), "an array [8] of float32", "[B, S] = [1, 8]", "costs[None]"),
    row("array_of_objects", lambda: plan(NumpyCost(lambda costs: costs.astype(object))), "[1, 8] of object", "return an array of numbers"),
    row("array_of_none", lambda: plan(NumpyCost(lambda _: None)), "NumpyCost.get_cost returned None", "end the method with `return`"),
    row("array_ragged", lambda: plan(NumpyCost(lambda _: [[1.0, 2.0], [3.0]])), "a list of 2", "NumPy makes no array", "[B, S] = [1, 8]"),
    row("device_of_no_name", lambda: plan(StateCost(), solver_on("gpu")), "CEMSolver(device='gpu')", "no device of that name", "'cuda'"),
    row("numpy_in_gradients", lambda: in_gradients(lambda c: torch.from_numpy(c.numpy()).sum((2, 3))), "must stay within torch", "[B, S, H, A] = [2, 2, 2, 2]"),
    row("changed_in_place", lambda: in_gradients(lambda c: c.mul_(2).sum((2, 3))), "candidates.clone()"),
    row("candidates_not_used", lambda: in_gradients(lambda c: torch.ones(c.shape[:2], requires_grad=True) * 2), "depend on its parameters and not on the candidates"),
    row("backward_in_a_cost", lambda: plan(Returned(lambda costs: (costs.sum().backward(), costs)[1])), "leave backward() and autograd.grad out of it", "GradientSolver"),
    row("other_dtype", lambda: plan(OfCandidates(lambda c: torch.nn.Linear(4, 1).double()(c.flatten(2)).squeeze(-1))), "next(self.parameters()).dtype", "float32"),
    row("other_width", lambda: plan(OfCandidates(lambda c: torch.nn.Linear(7, 1)(c.flatten(2)))), "candidates [B, S, H, A] = [1, 8, 2, 2] float32 on cpu", "state [1, 8, 1, 7]"),
    row("frames_that_are_not_kept", lambda: plan(Frames()), "The model has history_len=3", "PlanConfig(history_len=1) gives it up to 1 frames (T)"),
    row(
        "frames_that_are_not_there_yet",
        lambda: plan(Frames(), config={**CONFIG, "history_len": 3}),
        *("The model has history_len=3", "gives it up to 3 frames (T)", "an episode that has just begun has one"),
    ),
    row("predictions_without_time", lambda: plan(shooting(lambda p: p[:, :, -1, 0])), "'predicted_emb', a tensor [1, 8]", "[B, S, T, D]", "predicted.unsqueeze(2)"),
    row("predictions_as_array", lambda: plan(shooting(lambda p: p.numpy())), "`predicted_emb`, which is an array [1, 8, 2, 2]", "torch.Tensor [B, S, T, D]"),
    row("objective_of_all", lambda: plan(shooting(lambda p: p, lambda info: info["predicted_emb"].mean())), "<lambda> returned a tensor []", "expected a tensor [B, S]"),
    row("objective_of_nothing", lambda: plan(shooting(lambda p: p, lambda _: None)), "<lambda> returned None", "expected a tensor [B, S]"),
    row("actions_ragged", lambda: act(lambda infos: [[0.0, 0.0], [0.0]]), "the policy `<lambda>` returned a list", "actions of shape (2, 2)", "[N, *A]"),
    row("actions_in_a_dict", lambda: act(lambda infos: {"action": torch.zeros(2, 2)}), "returned dict", "the value of the key that holds the actions"),
    row("actions_with_more", lambda: act(lambda infos: (torch.zeros(2, 2), None)), "returned a tuple of Tensor of shape [2, 2]", "return its first part alone"),
    row("actions_as_distribution", lambda: act(lambda infos: torch.distributions.Normal(torch.zeros(2, 2), 1)), "returned Normal", "distribution.sample()"),
    row("actions_as_text", lambda: act(lambda infos: "left"), "returned 'left'", "real numbers"),
    row("actions_complex", lambda: act(lambda infos: torch.zeros(2, 2, dtype=torch.complex64)), "complex64", "return the real part"),
    row("actions_without_data", lambda: act(lambda infos: torch.zeros(2, 2, device="meta")), "of shape [2, 2]", "the device `meta`"),
    row("one_action_for_all", lambda: act(lambda infos: torch.zeros(2)), "float32 of shape [2]", "one action was returned for all environments"),
    row("actions_infinite", lambda: act(lambda infos: np.full((2, 2), np.inf)), "the action [inf, inf] is not finite", "torch.isfinite", "np.clip"),
    row("network_without_actions", lambda: feed_forward(lambda infos: None), "Acts.get_action` returned None", "end the function with `return`"),
    row("network_with_more", lambda: feed_forward(lambda infos: (torch.zeros(2, 2), torch.zeros(1))), "Acts.get_action` returned a tuple", "its first part alone"),
    row("images_of_none", lambda: on_images(lambda image: None), "one image at a time: [C, H, W] = [3, 32, 32], uint8", "and returned None"),
    row("images_of_other_sizes", lambda: on_images(sizes()), "made [3, 17, 32] of image 0 and [3, 18, 32] of image 1", "crop or resize to a fixed size"),
    row("images_as_a_batch", lambda: on_images(lambda image: image.permute(0, 1, 4, 2, 3)), "one image at a time: [C, H, W] = [3, 32, 32]", "function(image[None])[0]"),
    row("images_as_text", lambda: on_images(lambda image: "image"), "and returned str; return a tensor or an array [C, H, W]"),
    row(
        "scaler_of_another_column",
        lambda: plan(StateCost(), process={"state": scaler(np.random.randn(9, 3))}),
        *("ZScoreScaler in process['state'] was fitted on rows of 3 values", "rows of 7", "fit it on the column 'state'"),
    ),
]


INPUTS: list[tuple[Callable[[Path], Any], list[str]]] = [
    (model_in_training_mode, ["WithDropout", "training mode", "Dropout", "eval()"]),
    (costs_of_nan, ["all 8 candidates have a cost that is not finite", "check the model"]),
    (costs_with_another_axis, ["CostWithAxis.get_cost", "[1, 8, 1]", "[B, S] = [1, 8]", "return costs.squeeze(-1)"]),
    (one_cost_for_all, ["CostOfMean.get_cost", "a tensor [] of float32", "[B, S] = [1, 8]", "mean((-2, -1))"]),
    (gradient_of_detached, ["CostByArgmin", "remove `detach()`"]),
    (goal_of_another_size, ["GoalMSE", "as [B, S, T, D]", "'goal_emb', a tensor [1, 1, 1]", "[16] and [1]"]),
    (fractional_horizon, ["horizon must be a whole number, got 2.5"]),
    (actions_by_column, ["shape [3, 2], one row per environment", "found float32 of shape [2, 3]"]),
    (flat_actions, ["shape [2, 2]", "found float32 of shape [4]"]),
    (actions_of_nan, ["environment 0", "the action [NaN, NaN] is not finite", "torch.isfinite of the infos"]),
    (more_clips_than_there_are, ["no batch of 1000 is full", "33 clips"]),
    (loader_of_no_steps, ["`num_steps`: 0 rows; use 1 or more"]),
    (images_of_torch, ["column 'pixels' is float32 of shape (3, 32, 32) per step", "images are uint8 (H, W, 3)"]),
    (module_without_get_cost, ["CEMSolver was given Linear, which has no get_cost(info_dict, candidates)"]),
    (process_of_actions, ["process names 'actions', which is no column (did you mean 'action'?)"]),
    (transform_of_pixel, ["transform names 'pixel', which is no column (did you mean 'pixels'?)"]),
    (batch_size_zero, ["batch_size must be >= 1 or None, got 0"]),
    (policy_without_get_action, ["FeedForwardPolicy was given Linear, which has no get_action(info)"]),
    (images_without_transform, ["without a transform, the model is given"]),
    *MORE,
]

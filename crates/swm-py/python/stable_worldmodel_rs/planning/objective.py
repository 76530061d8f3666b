"""Objectives: what the outcome of a rollout costs. Torch modules, to be put together and given to
:class:`~stable_worldmodel_rs.planning.ShootingCostEvaluator`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

try:
    import torch
except ImportError as _error:
    raise ImportError("objectives are torch modules, and torch is not installed; `pip install torch`") from _error

from .solver._checks import given
from .solver._errors import PlanAssertionError

if TYPE_CHECKING:
    from ..protocols import Objective

__all__ = ["ControlPenalty", "GoalMSE", "WeightedSum"]


def _of(info_dict: dict[str, Any], key: str, fix: str) -> torch.Tensor:
    """What an objective reads."""
    if key not in info_dict:
        raise ValueError(f"the objective reads `{key}`, and the rollout has {', '.join(info_dict)}; {fix}")
    value: Any = info_dict[key]
    if not isinstance(value, torch.Tensor):
        raise PlanAssertionError(f"the objective reads `{key}`, which is {given(value)}; {_SHAPES.get(key, 'give a torch.Tensor')}")
    return value


_SHAPES: dict[str, str] = {
    "predicted_emb": "let the model's `rollout` add a torch.Tensor [B, S, T, D]: an embedding per environment, candidate and frame",
    "goal_emb": "give a torch.Tensor [B, T, D]: an embedding per environment and frame",
    "action_candidates": "give a torch.Tensor [B, S, H, A]",
}


class GoalMSE(torch.nn.Module):
    """Squared distance of the last predicted embedding from the last frame of the goal.

    Reads ``info[pred_key]``, ``(B, S, T, ...)``, and ``info[goal_key]``, ``(B, T_goal, ...)``; gives ``(B, S)``. Axes
    behind the time are any, such as patches. No gradient flows into the goal.

    Args:
        pred_key: Where the predictions are.
        goal_key: Where the goal is.
        reduction: ``"sum"`` or ``"mean"`` over all axes of an embedding. In a sum of several sources, ``"mean"`` makes
            large embeddings weigh as much as small ones.
    """

    def __init__(
        self, pred_key: str = "predicted_emb", goal_key: str = "goal_emb", reduction: str = "sum"
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        if reduction not in ("sum", "mean"):
            raise ValueError(f"reduction must be 'sum' or 'mean', got {reduction!r}")
        self.pred_key = pred_key
        self.goal_key = goal_key
        self.reduction = reduction

    def forward(self, info_dict: dict[str, Any]) -> torch.Tensor:
        fix = "let the model's `rollout` add it to the dict that it returns"
        predicted = _of(info_dict, self.pred_key, f"{fix}, or give GoalMSE(pred_key=…)")
        if predicted.ndim < 3:
            raise PlanAssertionError(
                f"GoalMSE reads {self.pred_key!r}, {given(predicted)}; expected [B, S, T, D], an embedding per environment, candidate and frame: "
                "add the axes that `rollout` leaves out, such as predicted.unsqueeze(2) of one frame"
            )
        last = predicted[:, :, -1]
        fix = "give the evaluator an encode_goal"
        wanted = _of(info_dict, self.goal_key, f"{fix}, or GoalMSE(goal_key=…)")
        goal = wanted[:, -1].detach().unsqueeze(1) if wanted.ndim > 1 else wanted.detach()
        if wanted.ndim < 2 or last.shape[2:] != goal.shape[2:]:
            raise PlanAssertionError(
                f"GoalMSE compares {self.pred_key!r}, {given(predicted)}, as [B, S, T, D] with {self.goal_key!r}, {given(wanted)}, as [B, T, D]: of "
                f"the last frames, {list(last.shape[2:])} and {list(goal.shape[2:])}; give both one D: encode the goal as the observations"
            )
        error = (last - goal).pow(2).flatten(2) if last.ndim > 2 else (last - goal).pow(2).unsqueeze(-1)
        return error.sum(-1) if self.reduction == "sum" else error.mean(-1)


class ControlPenalty(torch.nn.Module):
    """Sum of squares of the candidates, ``info[action_key]``, ``(B, S, H, D)``: ``(B, S)``."""

    def __init__(self, action_key: str = "action_candidates") -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.action_key = action_key

    def forward(self, info_dict: dict[str, Any]) -> torch.Tensor:
        return _of(info_dict, self.action_key, "give ControlPenalty(action_key=…)").pow(2).flatten(2).sum(-1)


class WeightedSum(torch.nn.Module):
    """Weighted sum of objectives: ``WeightedSum([(1.0, GoalMSE()), (0.01, ControlPenalty())])``."""

    def __init__(self, terms: list[tuple[float, Objective]]) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        if not terms:
            raise ValueError("WeightedSum needs one term or more: [(weight, objective), ...]")
        self.weights: list[float] = [float(weight) for weight, _ in terms]
        modules = [term for _, term in terms if isinstance(term, torch.nn.Module)]
        # Only modules can be registered; other objectives are kept beside them.
        self.objectives: torch.nn.ModuleList | list[Objective] = (
            torch.nn.ModuleList(modules) if len(modules) == len(terms) else [term for _, term in terms]
        )

    def forward(self, info_dict: dict[str, Any]) -> torch.Tensor:
        values = [weight * term(info_dict) for weight, term in zip(self.weights, self.objectives, strict=True)]
        return torch.stack(values).sum(0) if len(values) > 1 else values[0]

"""What planning asks of models, costs and policies, as structural types.

A class needs no base class to be one of these: having the methods is enough, and ``isinstance`` checks for them.
Shapes: B plans, S candidates, H blocks, D = action_block × action values, C constraints.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np
    import torch

__all__ = ["Actionable", "Constrainable", "Costable", "Dynamics", "Objective", "Transformable"]


@runtime_checkable
class Costable(Protocol):
    """What solvers minimize: anything with ``get_cost``.

    A cost with ``array_api = "numpy"`` gets NumPy arrays and returns one; any other cost gets torch tensors. A NumPy
    cost that gradient solvers can use has ``get_cost_and_gradient(info, candidates)`` as well, which returns costs
    ``(B, S)`` and their derivative ``(B, S, H, D)``.
    """

    def get_cost(self, info_dict: dict[str, Any], action_candidates: Any) -> Any:
        """The cost ``(B, S)`` of every candidate ``(B, S, H, D)``; lower is better.

        Candidates are within the bounds of the actions, unless ``PlanConfig`` has ``clip_actions=False``.
        Entries of ``info_dict`` have the candidate axis already: ``(B, S, ...)``, expanded without a copy.
        The same dict is passed in every iteration of a plan, so a cost may keep an encoded goal in it.
        """
        ...


@runtime_checkable
class Constrainable(Protocol):
    """A cost with inequality constraints; a plan is feasible where all of them are 0 or less."""

    def get_constraints(self, info_dict: dict[str, Any], action_candidates: Any) -> Any:
        """The constraints ``(B, S, C)`` of every candidate ``(B, S, H, D)``."""
        ...


@runtime_checkable
class Dynamics(Protocol):
    """The world model that a :class:`~stable_worldmodel_rs.planning.ShootingCostEvaluator` needs.

    What is behind the leading axes of an image is up to the ``transform`` of
    :class:`~stable_worldmodel_rs.WorldModelPolicy`: ``(C, h, w)``, as it returns them. Without a transform, images are
    those of the infos, ``(h, w, C)`` uint8. Other columns are as the infos have them, floating point as float32, and as
    ``process`` scales them.
    """

    def encode(self, x: dict[str, Any]) -> dict[str, Any]:
        """Adds latent embeddings ``emb``, ``(B, T, dim)``, to a dict of observations.

        The evaluator calls it once per plan, with the goal and T = 1: ``x["pixels"]`` is the goal's image,
        ``(B, 1, C, h, w)`` with a transform and ``(B, 1, h, w, C)`` uint8 without; ``x["<column>"]`` is
        ``goal_<column>``, ``(B, 1, ...)``, where there is one. Actions are left out.
        """
        ...

    def rollout(self, info_dict: dict[str, Any], action_candidates: torch.Tensor) -> dict[str, Any]:
        """Predicts the outcome of candidates ``(B, S, H, D)``.

        ``info_dict["pixels"]`` holds T frames of context, ``(B, S, T, C, h, w)`` with a transform and
        ``(B, S, T, h, w, C)`` uint8 without, the same frames for all S, expanded without a copy. All else that is observed
        has T frames, too. T is 1 unless ``PlanConfig`` has a ``history_len``, and less than that where an episode is younger:
        write models for any T from 1 on. With T > 1 ``action_history`` holds the blocks executed between them,
        ``(B, S, T - 1, D)``. Adds ``predicted_emb``, ``(B, S, T + H, dim)``, whose first T entries are the encoded
        frames.
        """
        ...


@runtime_checkable
class Objective(Protocol):
    """Rates rollouts that a model has made: ``info_dict`` holds ``predicted_emb``, ``goal_emb``, and the like."""

    def __call__(self, info_dict: dict[str, Any]) -> torch.Tensor:
        """The cost ``(B, S)``."""
        ...


class Transformable(Protocol):
    """A reversible scaling of a column, such as ``sklearn.preprocessing.StandardScaler``."""

    def transform(self, x: np.ndarray) -> np.ndarray:
        """Scales ``(rows, dim)``."""
        ...

    def inverse_transform(self, x: np.ndarray) -> np.ndarray:
        """The inverse of :meth:`transform`."""
        ...


@runtime_checkable
class Actionable(Protocol):
    """A model that proposes actions by itself. Solvers start from them where a warm start ends."""

    def get_action(
        self, info: dict[str, Any], horizon: int = 1, prefix_actions: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Actions ``(..., D)``, or ``(..., horizon, D)`` for a horizon above 1.

        ``prefix_actions``, ``(..., t, D)``, are taken first, before the ones that are asked for.
        """
        ...

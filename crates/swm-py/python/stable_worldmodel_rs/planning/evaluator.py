"""A world model and an objective as a cost: encode the goal, roll the candidates out, rate the outcome."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

try:
    import torch
except ImportError as _error:
    raise ImportError(
        "ShootingCostEvaluator is a torch module, and torch is not installed; `pip install torch`"
    ) from _error

from .._prepare import require_method
from .solver._checks import given
from .solver._errors import PlanAssertionError

if TYPE_CHECKING:
    from ..protocols import Dynamics, Objective

__all__ = ["ShootingCostEvaluator", "default_goal_encode", "flat_goal_encode", "split_goal_encode"]


def _goal_inputs(info_dict: dict[str, Any]) -> dict[str, Any]:
    """The tensors of ``info_dict`` without the candidate axis."""
    if "goal" not in info_dict:
        known = ", ".join(info_dict)
        raise AssertionError(
            f"goal not in info_dict, which has {known}. A model of images needs image_shape=(H, W) and goal_conditioned=True of "
            "World or make_manifest; for a model of other columns, give the evaluator encode_goal=lambda model, info: the "
            "embedding of a goal's column, such as info['goal_state'][:, 0]; for an objective without a goal, encode_goal=None"
        )
    return {key: value[:, 0] for key, value in info_dict.items() if torch.is_tensor(value)}


def flat_goal_encode(model: Dynamics, info_dict: dict[str, Any]) -> torch.Tensor:
    """The goal's embedding for models of one latent (LeWM, PLDM): ``goal`` is encoded as ``pixels``, ``goal_x`` as ``x``.

    Returns:
        ``(B, T_goal, ...)``: ``model.encode(...)["emb"]``.
    """
    goal = _goal_inputs(info_dict)
    goal["pixels"] = goal["goal"]
    for key in [key for key in goal if key.startswith("goal_")]:
        goal[key.removeprefix("goal_")] = goal.pop(key)
    # A goal is a state: what was done, or will be, is no part of it.
    goal.pop("action", None)
    goal.pop("action_history", None)
    encoded = cast("Any", model.encode(goal))
    if not isinstance(encoded, dict) or "emb" not in encoded:
        known = cast("dict[str, Any]", encoded)
        has = ", ".join(map(str, known)) if isinstance(encoded, dict) else type(known).__name__
        raise TypeError(
            f"{type(model).__name__}.encode returned {has}; it must return a dict with the embedding as `emb`, [B, T, …], or give the "
            "evaluator another encode_goal"
        )
    found: Any = cast("dict[str, Any]", encoded)["emb"]
    if not isinstance(found, torch.Tensor):
        raise TypeError(f"{type(model).__name__}.encode gave `emb` as {given(found)}; give a torch.Tensor [B, T, D]")
    return found


def split_goal_encode(model: Any, info_dict: dict[str, Any]) -> torch.Tensor:
    """The goal's embeddings for models whose latent joins several sources (PreJEPA, DINO-WM).

    Stores the embedding of each source in ``info_dict``, as ``pixels_goal_emb`` and ``<key>_goal_emb``, for one
    :class:`~stable_worldmodel_rs.planning.GoalMSE` each. The encoder of actions is left out.

    Returns:
        The joined embedding, ``goal_emb``.
    """
    keys = [key for key in model.extra_encoders if key != "action"]
    goal = model.encode(
        _goal_inputs(info_dict), target="goal_emb", pixels_key="goal", prefix="goal_", emb_keys=keys
    )
    for key in ("goal_emb", "pixels_goal_emb", *(f"{key}_goal_emb" for key in keys)):
        info_dict[key] = goal[key]
    return info_dict["goal_emb"]


def default_goal_encode(model: Any, info_dict: dict[str, Any]) -> torch.Tensor:
    """:func:`split_goal_encode` for a model with ``extra_encoders``, else :func:`flat_goal_encode`."""
    encode = split_goal_encode if getattr(model, "extra_encoders", None) else flat_goal_encode
    return encode(model, info_dict)


class ShootingCostEvaluator(torch.nn.Module):
    """A cost of whole plans: the model rolls every candidate out, the objective rates where it ends.

    Args:
        model: The world model: ``encode`` and ``rollout`` (:class:`~stable_worldmodel_rs.protocols.Dynamics`).
        objective: Rates a rollout, ``(B, S)``.
        constraints: Objectives that must be 0 or less, for
            :class:`~stable_worldmodel_rs.planning.LagrangianSolver`. With them the evaluator has ``get_constraints``.
        encode_goal: ``f(model, info_dict)`` that gives ``goal_emb``; None where no goal is needed. It is called once per
            plan, as solvers pass the same dict in every iteration.

    Example:
        >>> cost = ShootingCostEvaluator(model, GoalMSE())  # doctest: +SKIP
        >>> policy = WorldModelPolicy(CEMSolver(cost, device="cuda"), config)  # doctest: +SKIP
    """

    def __init__(
        self,
        model: Dynamics,
        objective: Objective,
        constraints: Sequence[Objective] | None = None,
        encode_goal: Callable[[Any, dict[str, Any]], torch.Tensor] | None = default_goal_encode,
    ) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        hint = "encode(x) adds emb, (B, T, dim); stable_worldmodel_rs.protocols.Dynamics has the shapes"
        needed = "rollout(info_dict, candidates), which adds predicted_emb, (B, S, T + H, dim)"
        require_method("ShootingCostEvaluator", model, "rollout", needed, hint)
        if not callable(objective) or isinstance(objective, type):
            raise TypeError(
                f"ShootingCostEvaluator was given the objective {objective!r}; give a function or module of the rollout's infos "
                "that returns costs (B, S), such as GoalMSE()"
            )
        self.model: Any = model
        self.objective: Any = objective
        self.constraints: list[Objective] | None = list(constraints) if constraints else None
        self.encode_goal = encode_goal
        if self.constraints:
            self.get_constraints: Callable[[dict[str, Any], torch.Tensor], torch.Tensor] = self._get_constraints

    def _rollout(self, info_dict: dict[str, Any], action_candidates: torch.Tensor) -> dict[str, Any]:
        if self.encode_goal is not None and "goal_emb" not in info_dict:
            info_dict["goal_emb"] = self.encode_goal(self.model, info_dict)
        found: Any = self.model.rollout(info_dict, action_candidates)
        if not isinstance(found, dict):
            raise TypeError(
                f"{type(self.model).__name__}.rollout returned {type(found).__name__}; it must return the dict that it is given, with its "
                "predictions added, as info['predicted_emb'] of shape [B, S, T + H, …]"
            )
        info_dict = cast("dict[str, Any]", found)
        info_dict["action_candidates"] = action_candidates
        return info_dict

    def criterion(
        self, info_dict: dict[str, Any], action_candidates: torch.Tensor | None = None
    ) -> torch.Tensor:
        """The cost ``(B, S)`` of a dict that holds a rollout already."""
        if action_candidates is not None:
            info_dict["action_candidates"] = action_candidates
        return self.objective(info_dict)

    def get_cost(self, info_dict: dict[str, Any], action_candidates: torch.Tensor) -> torch.Tensor:
        """The cost ``(B, S)`` of candidates ``(B, S, H, D)``."""
        return self._rated(self.objective, self._rollout(info_dict, action_candidates))

    @staticmethod
    def _rated(objective: Any, info_dict: dict[str, Any]) -> torch.Tensor:
        """What an objective gives, if it gives ``(B, S)``."""
        costs: Any = objective(info_dict)
        # How many they are is compared by the solver: here, an export may leave B and S open.
        if not isinstance(costs, torch.Tensor) or costs.ndim != 2:
            name = getattr(objective, "__name__", type(objective).__name__)
            raise PlanAssertionError(
                f"the objective {name} returned {given(costs)}; expected a tensor [B, S], a cost per environment and candidate: "
                "reduce over all axes behind S, and over no other, such as error.flatten(2).sum(-1)"
            )
        return costs

    def _get_constraints(self, info_dict: dict[str, Any], action_candidates: torch.Tensor) -> torch.Tensor:
        info_dict = self._rollout(info_dict, action_candidates)
        return torch.stack([self._rated(term, info_dict) for term in self.constraints or []], dim=-1)

"""Where a search begins: the rest of the last plan, continued by the model's own actions or by zeros."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...protocols import Actionable
from ._checks import given
from ._errors import PlanAssertionError

if TYPE_CHECKING:
    import torch

__all__ = ["prepare_init_action"]


def prepare_init_action(
    model: Any,
    info_dict: dict[str, Any],
    init_action: torch.Tensor | None,
    horizon: int,
    n_envs: int,
    action_dim: int,
    device: str | torch.device | None = None,
) -> torch.Tensor:
    """A plan of ``horizon`` blocks that begins with ``init_action``.

    What is missing comes from ``model.get_action(info_dict, horizon=missing, prefix_actions=init_action)`` if the
    model has that method (:class:`~stable_worldmodel_rs.protocols.Actionable`), else it is zeros.

    Args:
        model: The cost or model that is planned with.
        info_dict: Observations, ``(n_envs, ...)`` each.
        init_action: The beginning of the plan, ``(n_envs, t, action_dim)``, or None.
        horizon: H, blocks of a plan.
        n_envs: Rows of the plan.
        action_dim: D, values of a block.
        device: Where the result is; None: where ``init_action`` is, else on the CPU.

    Returns:
        ``(n_envs, horizon, action_dim)``, or ``init_action`` where that is as long already.
    """
    import torch

    parts: list[torch.Tensor] = []
    if init_action is not None:
        if init_action.ndim != 3 or init_action.shape[0] != n_envs or init_action.shape[2] != action_dim:
            raise PlanAssertionError(
                f"init_action has the shape {tuple(init_action.shape)}, and the solver plans for {n_envs} rows of "
                f"blocks of {action_dim} values; give ({n_envs}, t, {action_dim})"
            )
        parts.append(init_action if device is None else init_action.to(device))
    missing = horizon - (parts[0].shape[1] if parts else 0)
    if missing <= 0:
        return parts[0]
    if isinstance(model, Actionable):
        with torch.no_grad():
            tail = model.get_action(info_dict, horizon=missing, prefix_actions=parts[0] if parts else None)
        found: Any = tail
        if isinstance(found, torch.Tensor) and found.ndim == 2:  # Models drop the axis of a horizon of 1.
            found = found.unsqueeze(1)
        if not isinstance(found, torch.Tensor) or tuple(found.shape) != (n_envs, missing, action_dim):
            raise PlanAssertionError(
                f"{type(model).__name__}.get_action(info, horizon={missing}) returned {given(tail)}; expected actions [B, H, A] = "
                f"[{n_envs}, {missing}, {action_dim}], with A = action_block × values of an action: a model of single actions plans with "
                "PlanConfig(action_block=1)"
            )
        tail = found
        tail = tail if device is None else tail.to(device)
    else:
        where = device if device is not None else (parts[0].device if parts else "cpu")
        tail = torch.zeros(n_envs, missing, action_dim, device=where)
    return torch.cat([parts[0].to(tail.device), tail], dim=1) if parts else tail

"""The augmented Lagrangian method: gradient descent under constraints."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._arrays import Array
from ._bridge import Bridge
from ._descent import OptimizerSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["LagrangianSolver"]


@dataclass(eq=False, repr=False)
class LagrangianSolver(OptimizerSolver):
    """Descends on the cost plus a penalty for violated constraints that grows every round.

    A cost with ``get_constraints(info, candidates)``, ``(b, S, C)``, is feasible where all of them are 0 or less; an
    equality is two of them. Costs and constraints must be differentiable. Without constraints this is gradient descent
    whose optimizer restarts every round.

    Args:
        n_steps: Gradient steps per round.
        persist_multipliers: Begin with the multipliers of the episode's last plan.
        optimizer_cls: ``torch.optim.Adam`` (as None), ``AdamW`` or ``SGD``, or one of their names.
        optimizer_kwargs: ``{"lr": …}``; the default 1.0 is the reference's, and too long a step for most problems.
        form: The reference's penalty, Σ λ g + ρ max(0, g)², with multipliers λ shared by the sequences of a row
            (``"reference"``), or the textbook's, Σ (max(0, λ + ρ g)² - λ²) / 2ρ, where slack costs nothing and every
            sequence has its own (``"standard"``).
        tolerance: Largest constraint with which a plan counts as feasible. Of the final sequences a feasible one is
            returned, if there is one, and the cheapest of those.

    ``solve`` returns ``actions``; ``costs`` of the plans; ``lambdas``, ``(B, C)`` or None; ``constraint_violation``, per
    chunk of rows the mean of max(0, g).
    """

    native_name = "lagrangian"

    _optimizers = {"adam": ("lr",), "adamw": ("lr",), "sgd": ("lr",)}

    cost: Any
    n_steps: int
    n_outer_steps: int = 5
    batch_size: int | None = None
    num_samples: int = 1
    var_scale: float = 1.0
    action_noise: float = 0.0
    rho_init: float = 1.0
    rho_max: float = 1e4
    rho_scale: float = 2.0
    persist_multipliers: bool = True
    device: str | torch.device = "cpu"
    seed: int = 1234
    optimizer_cls: type[torch.optim.Optimizer] | str | None = None
    optimizer_kwargs: dict[str, Any] | None = None
    _: KW_ONLY
    form: str = "reference"
    clip: bool = False
    tolerance: float = 0.001
    callbacks: Sequence[Callback] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._lambdas: Any = None
        self._constraint_count: int | None = None

    def settings(self) -> dict[str, Any]:
        name, kwargs = self._optimizer()
        return super().settings() | kwargs | {"optimizer": name}

    def _costs(self) -> str:
        return "cost"

    def _constraints(self, bridge: Bridge, initial: Array) -> int:
        if self._constraint_count is None:
            self._constraint_count = bridge.count_constraints(np.ascontiguousarray(initial[:, None]))
        return self._constraint_count

    def init_action(self, actions: torch.Tensor | None = None) -> None:
        """Sets ``init`` to the sequences that the next ``solve`` begins with, ``(n_envs, S, H, D)``.

        ``actions``, ``(n_envs, t, D)``, are the beginning of the first sequence; zeros follow.
        """
        self.init: torch.Tensor = self._starts(self.n_envs, actions, iterations=1, rounds=1)

    def solve(self, info_dict: dict[str, Any], init_action: Any = None, **kwargs: Any) -> dict[str, Any]:
        if not self.persist_multipliers:
            self._memory.clear()
        return super().solve(info_dict, init_action, **kwargs)

    def _finish(self, results: list[dict[str, Any]], bridges: list[Bridge]) -> dict[str, Any]:
        if self._constraint_count:
            kept = [values for result in results for values in result["memory"]]
            self._lambdas = self.as_given(np.stack(kept).astype(np.float32))
        violation = [bridge.violation for bridge in bridges] if self._constraint_count else []
        return super()._finish(results, bridges) | {"constraint_violation": violation, "lambdas": self._lambdas}

"""Gradient descent on plans."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any

from ._descent import OptimizerSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["GradientSolver"]

_ADAM: tuple[str, ...] = ("lr", "beta1", "beta2", "eps", "weight_decay")


@dataclass(eq=False, repr=False)
class GradientSolver(OptimizerSolver):
    """Descends along the gradient of the cost, from several starts, and returns the cheapest end.

    The cost must be differentiable: torch computes the gradient by ``torch.autograd.grad``, which leaves the gradients
    of the model's parameters alone. A NumPy cost needs ``get_cost_and_gradient``.

    Args:
        optimizer_cls: ``torch.optim.SGD`` (as None), ``Adam`` or ``AdamW``, or one of their names.
        optimizer_kwargs: Its settings; the default is ``{"lr": 1.0}``, which suits few problems.
        grad_clip: Largest norm of a gradient; None: no limit.
        grad_clip_mode: Whose norm: each sequence's (``"sequence"``), or that of all of a chunk as one vector, as the
            reference does (``"global"``; plans then depend on ``batch_size``).

    ``solve`` returns ``actions`` and ``costs``, those of the plans.
    """

    _optimizers = {"sgd": ("lr", "momentum", "nesterov"), "adam": _ADAM, "adamw": _ADAM}

    cost: Any
    n_steps: int
    batch_size: int | None = None
    var_scale: float = 1.0
    num_samples: int = 1
    action_noise: float = 0.0
    device: str | torch.device = "cpu"
    seed: int = 1234
    optimizer_cls: type[torch.optim.Optimizer] | str | None = None
    optimizer_kwargs: dict[str, Any] | None = None
    grad_clip: float | None = None
    callbacks: Sequence[Callback] | None = None
    _: KW_ONLY
    grad_clip_mode: str = "sequence"
    clip: bool = False
    track_best: bool = False

    @property
    def native_name(self) -> str:  # type: ignore[override]
        return self._optimizer()[0]

    def settings(self) -> dict[str, Any]:
        limit = 0.0 if self.grad_clip is None else float(self.grad_clip)
        return super().settings() | {"grad_clip": limit} | self._optimizer()[1]

    def init_action(self, n_envs: int, actions: torch.Tensor | None = None) -> None:
        """Sets ``init`` to the sequences that the next ``solve`` begins with, ``(n_envs, S, H, D)``.

        ``actions``, ``(n_envs, t, D)``, are the beginning of the first sequence; zeros follow.
        """
        self.init: torch.Tensor = self._starts(n_envs, actions, iterations=0)

"""Gradient descent on plans."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._descent import DescentSolver, optimizer_settings

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["GradientSolver"]

_ADAM: tuple[str, ...] = ("lr", "beta1", "beta2", "eps", "weight_decay")
_KNOWN: dict[str, tuple[str, ...]] = {"sgd": ("lr", "momentum", "nesterov"), "adam": _ADAM, "adamw": _ADAM}


class GradientSolver(DescentSolver):
    """Descends along the gradient of the cost, from several starts, and returns the cheapest end.

    The cost must be differentiable: torch computes the gradient by ``torch.autograd.grad``, which leaves the gradients
    of the model's parameters alone. A NumPy cost needs ``get_cost_and_gradient``.

    Args:
        cost: What to minimize.
        n_steps: Gradient steps.
        batch_size: Rows that the cost is given at once; None: all.
        var_scale: Standard deviation of the other starts around the first, which is the warm start.
        num_samples: S, starts.
        action_noise: Standard deviation of the noise added after every step.
        device: Where the cost is given its candidates.
        seed: Seed of the noise, in addition to the episode's.
        optimizer_cls: ``torch.optim.SGD`` (as None), ``Adam`` or ``AdamW``, or one of their names.
        optimizer_kwargs: Its settings; the default is ``{"lr": 1.0}``, which suits few problems.
        grad_clip: Largest norm of a gradient; None: no limit.
        callbacks: Recorders of every step.
        grad_clip_mode: Whose norm: each sequence's (``"sequence"``), or that of all of a chunk as one vector, as the
            reference does (``"global"``; plans then depend on ``batch_size``).
        clip: Clip plans to the bounds of the actions.
        track_best: Return the cheapest plan of all steps, not of the last.

    ``solve`` returns ``actions`` and ``costs``, those of the plans.
    """

    def __init__(
        self,
        cost: Any,
        n_steps: int,
        batch_size: int | None = None,
        var_scale: float = 1.0,
        num_samples: int = 1,
        action_noise: float = 0.0,
        device: str | torch.device = "cpu",
        seed: int = 1234,
        optimizer_cls: type[torch.optim.Optimizer] | str | None = None,
        optimizer_kwargs: dict[str, Any] | None = None,
        grad_clip: float | None = None,
        callbacks: Sequence[Callback] | None = None,
        *,
        grad_clip_mode: str = "sequence",
        clip: bool = False,
        track_best: bool = False,
    ) -> None:
        super().__init__(cost, n_steps, batch_size, var_scale, num_samples, action_noise, device, seed, callbacks)
        self.optimizer_cls = optimizer_cls
        self.optimizer_kwargs: dict[str, Any] = {"lr": 1.0} if optimizer_kwargs is None else dict(optimizer_kwargs)
        self.grad_clip = grad_clip
        self.grad_clip_mode = grad_clip_mode
        self.clip = clip
        self.track_best = track_best
        self._optimizer()

    def _optimizer(self) -> tuple[str, dict[str, Any]]:
        chosen = "sgd" if self.optimizer_cls is None else self.optimizer_cls
        return optimizer_settings(type(self).__name__, chosen, self.optimizer_kwargs, _KNOWN)

    @property
    def native_name(self) -> str:  # type: ignore[override]
        return self._optimizer()[0]

    def settings(self) -> dict[str, Any]:
        return {
            **super().settings(),
            **self._optimizer()[1],
            "grad_clip": 0.0 if self.grad_clip is None else float(self.grad_clip),
            "grad_clip_mode": self.grad_clip_mode,
            "clip": self.clip,
            "track_best": self.track_best,
        }

    def init_action(self, n_envs: int, actions: torch.Tensor | None = None) -> None:
        """Sets ``init`` to the sequences that the next ``solve`` begins with, ``(n_envs, S, H, D)``.

        ``actions``, ``(n_envs, t, D)``, are the beginning of the first sequence; zeros follow.
        """
        self.init: torch.Tensor = self._starts(n_envs, actions, iterations=0)

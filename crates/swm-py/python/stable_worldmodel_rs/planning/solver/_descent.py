"""What solvers that follow the gradient of a cost share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._base import BaseSolver
from ._bridge import Bridge

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from .callbacks import Callback

__all__ = ["DescentSolver", "optimizer_settings"]


class DescentSolver(BaseSolver):
    """The base of gradient solvers: several sequences per row, of which the cheapest is returned."""

    init: torch.Tensor
    """Where the sequences began, ``(n_envs, S, H, D)``; made by ``init_action``."""

    def __init__(
        self,
        cost: Any,
        n_steps: int,
        batch_size: int | None,
        var_scale: float,
        num_samples: int,
        action_noise: float,
        device: str | torch.device,
        seed: int,
        callbacks: Sequence[Callback] | None,
    ) -> None:
        super().__init__(cost, batch_size, num_samples, device, seed, callbacks)
        self.n_steps = n_steps
        self.var_scale = var_scale
        self.action_noise = action_noise

    @property
    def uses_gradient(self) -> bool:
        return True

    def settings(self) -> dict[str, Any]:
        return {
            "samples": self.num_samples,
            "iterations": self.n_steps,
            "sigma": float(self.var_scale),
            "action_noise": float(self.action_noise),
        }

    def _finish(self, results: list[dict[str, Any]], bridges: list[Bridge]) -> dict[str, Any]:
        # Of integers, the cost of the mixture that was rounded, as in the reference, unless rounded plans are compared.
        return {"costs": np.concatenate([result["elite_mean"] for result in results]).tolist()}


def optimizer_settings(
    solver: str, optimizer: type[Any] | str | None, kwargs: dict[str, Any], known: dict[str, tuple[str, ...]]
) -> tuple[str, dict[str, Any]]:
    """The Rust optimizer of a class of ``torch.optim`` (or its name), and its settings.

    ``known`` are the arguments that each optimizer takes here.
    """
    name = optimizer if isinstance(optimizer, str) else getattr(optimizer, "__name__", str(optimizer))
    name = name.lower()
    if name not in known:
        raise ValueError(
            f"{solver} descends with SGD, Adam or AdamW, not with {optimizer!r}; use optimizer_cls=torch.optim.Adam"
        )
    given = dict(kwargs)
    if "betas" in given and "beta1" in known[name]:
        given["beta1"], given["beta2"] = given.pop("betas")
    # What is off anyway may be said.
    given = {key: value for key, value in given.items() if key in known[name] or value}
    unknown = sorted(set(given) - set(known[name]))
    if unknown:
        takes = ", ".join(known[name])
        raise ValueError(f"{solver} with {name} does not know optimizer_kwargs {', '.join(unknown)}; it knows {takes}")
    return name, {key: value if isinstance(value, bool) else float(value) for key, value in given.items()}

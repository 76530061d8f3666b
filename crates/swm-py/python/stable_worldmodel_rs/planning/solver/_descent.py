"""What solvers that follow the gradient of a cost share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from ._base import BaseSolver

if TYPE_CHECKING:
    import torch

__all__ = ["DescentSolver", "OptimizerSolver"]


class DescentSolver(BaseSolver):
    """The base of gradient solvers: several sequences per row, of which the cheapest is returned."""

    init: torch.Tensor
    """Where the sequences began, ``(n_envs, S, H, D)``; made by ``init_action``."""

    @property
    def uses_gradient(self) -> bool:
        return True


class OptimizerSolver(DescentSolver):
    """The base of gradient solvers with a choice of optimizers."""

    optimizer_cls: type[torch.optim.Optimizer] | str | None
    optimizer_kwargs: dict[str, Any] | None
    """A dict as soon as the solver is made."""
    _optimizers: ClassVar[dict[str, tuple[str, ...]]]
    """The optimizers with the arguments that each takes here; the first is the one for None."""

    def __post_init__(self) -> None:
        self.optimizer_kwargs = {"lr": 1.0} if self.optimizer_kwargs is None else dict(self.optimizer_kwargs)
        super().__post_init__()

    def _optimizer(self) -> tuple[str, dict[str, Any]]:
        """The Rust optimizer, and its settings."""
        chosen = next(iter(self._optimizers)) if self.optimizer_cls is None else self.optimizer_cls
        return optimizer_settings(type(self).__name__, chosen, self.optimizer_kwargs or {}, self._optimizers)


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

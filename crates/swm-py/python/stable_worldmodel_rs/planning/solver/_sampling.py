"""What solvers that sample plans and refit a distribution to the cheapest of them share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._base import BaseSolver, joined, torch_of
from ._bridge import Bridge

if TYPE_CHECKING:
    import torch

__all__ = ["SamplingSolver"]


class SamplingSolver(BaseSolver):
    """The base of solvers that keep a mean and a standard deviation."""

    var_scale: float

    def init_action_distrib(
        self, n_envs: int, actions: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and standard deviation that the search begins with, ``(n_envs, H, D)`` each.

        ``actions``, ``(n_envs, t, D)``, are the beginning of the mean; zeros follow.
        """
        shape = (n_envs, self.horizon, self.action_dim)
        var = torch_of(self.cost).full(shape, float(self.var_scale), dtype=self.dtype)
        return self._continued(n_envs, actions), var

    def _finish(self, results: list[dict[str, Any]], bridges: list[Bridge]) -> dict[str, Any]:
        spread = {"mean": [self.as_given(joined(results, "mean"))], "var": [self.as_given(joined(results, "std"))]}
        return super()._finish(results, bridges) | spread

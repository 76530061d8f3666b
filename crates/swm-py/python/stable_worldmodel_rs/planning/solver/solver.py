"""The interface of a solver, which :class:`~stable_worldmodel_rs.policy.WorldModelPolicy` plans with."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from ...protocols import Constrainable, Costable

if TYPE_CHECKING:
    import gymnasium as gym

__all__ = ["Constrainable", "Costable", "Solver"]


@runtime_checkable
class Solver(Protocol):
    """Searches for the cheapest plan."""

    def configure(self, *, action_space: gym.Space[Any], n_envs: int, config: Any) -> None:
        """Tells the actions of the environments, ``(n_envs, ...)``, and the lengths of plans (a ``PlanConfig``)."""
        ...

    @property
    def action_dim(self) -> int:
        """D: values of a block of actions."""
        ...

    @property
    def n_envs(self) -> int:
        """How many environments there are."""
        ...

    @property
    def horizon(self) -> int:
        """H: blocks of a plan."""
        ...

    def solve(self, info_dict: dict[str, Any], init_action: Any = None) -> dict[str, Any]:
        """Plans for the rows of ``info_dict``: a dict with ``actions``, ``(B, H, D)``, and more."""
        ...

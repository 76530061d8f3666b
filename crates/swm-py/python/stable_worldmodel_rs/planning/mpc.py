"""Planners that run in Rust as a whole: the solver, and a cost that is no Python object."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal

from ..world.policies import NativePolicy
from .solver._base import BaseSolver
from .solver._errors import PlanAssertionError

__all__ = ["MpcPolicy", "SimulatorCost"]


@dataclass(frozen=True)
class SimulatorCost:
    """Plans on the true dynamics: every candidate is simulated in a copy of the environment, in parallel.

    It is an oracle, and the expert of environments without a scripted one. It needs an environment of this package that
    has a task cost.

    Args:
        aggregate: Cost of a rollout: the ``"last"``, ``"mean"`` or ``"best"`` task cost.
        success_bonus: A rollout that succeeds at its step t costs t minus this; 0: no bonus.
        stop_at_success: End rollouts at the environment's own success.
        gradient_step: Step of finite-difference gradients, for solvers that need them.
    """

    aggregate: Literal["last", "mean", "best"] = "last"
    success_bonus: float = 1000.0
    stop_at_success: bool = True
    gradient_step: float = 0.01
    is_native: ClassVar[bool] = True


class MpcPolicy(NativePolicy):
    """Plans with a solver on a native cost, executes ``receding_horizon`` blocks, and plans again: all in Rust.

    For costs in Python, such as a torch model, use :class:`~stable_worldmodel_rs.policy.WorldModelPolicy`.

    Args:
        solver: A solver of this package, or its name with settings: ``"cem:samples=300,iterations=10"``.
        cost: A :class:`SimulatorCost`; None takes that of the solver, or the default one.
        config: A :class:`~stable_worldmodel_rs.policy.PlanConfig`; None takes the defaults of the command.
        clip_actions: Clip actions to the action space; ``config`` has the same setting, and either can turn it off.

    Example:
        >>> from stable_worldmodel_rs import MpcPolicy, PlanConfig
        >>> from stable_worldmodel_rs.planning import CEMSolver, SimulatorCost
        >>> solver = CEMSolver(SimulatorCost(), num_samples=64, n_steps=5, topk=8)
        >>> policy = MpcPolicy(solver, config=PlanConfig(horizon=5, receding_horizon=5, action_block=5))
        >>> policy.text  # doctest: +ELLIPSIS
        'cem:seed=1234,samples=64,iterations=5,elites=8,...'
        >>> world.set_policy(policy)  # doctest: +SKIP
    """

    def __init__(
        self,
        solver: BaseSolver | str,
        cost: SimulatorCost | None = None,
        config: Any = None,
        *,
        clip_actions: bool = True,
    ) -> None:
        settings: dict[str, Any] = {}
        if isinstance(solver, str):
            name = solver
        else:
            own = solver.cost
            if own is not None and not isinstance(own, SimulatorCost):
                raise PlanAssertionError(
                    f"MpcPolicy plans in Rust, and {type(own).__name__} is a Python object; use "
                    "WorldModelPolicy(solver, config), or MpcPolicy with a SimulatorCost"
                )
            cost = cost if cost is not None else own
            # The seed of the solver's noise; `seed=` of a NativePolicy would replace those of the episodes.
            name = f"{solver.native_name}:seed={solver.seed & 0xFFFF_FFFF}"
            settings |= solver.settings()
        for field in fields(SimulatorCost):
            value = getattr(cost, field.name) if cost is not None else field.default
            if value != field.default:
                settings[field.name] = value
        if config is not None:
            for setting in ("horizon", "receding_horizon", "history_len", "action_block", "warm_start"):
                settings[setting] = getattr(config, setting)
        if not (clip_actions and getattr(config, "clip_actions", True)):
            settings["clip_actions"] = False
        super().__init__(name, **settings)

    def __repr__(self) -> str:
        return f"MpcPolicy({self.text!r})"

"""`EnvPool`: environments that are Python objects, stepped one after the other.

For environments of gymnasium that this package does not have. The package's own run in Rust, in a `NativePool` with the
same methods; `World` picks the right one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector.utils import batch_space, iterate

from .._arguments import kind_of
from .._core import core as _swm
from .columns import Table

__all__ = ["EnvPool"]

Mask = Sequence[bool] | npt.NDArray[np.bool_]
# What the methods of an environment return.
_RETURNS = {"reset": ("observation", "info"), "step": ("observation", "reward", "terminated", "truncated", "info")}


class EnvPool:
    """Environments with one interface and one table of infos.

    Args:
        env_fns: One function per environment, which makes it.

    The infos are a dict. Arrays, tensors, numbers and lists of numbers are stacked to ``(N, 1, …)``; other values are lists of
    lists ``[N][1]``. Nested dicts have dotted names: ``{"arm": {"angle": 0.5}}`` is ``arm.angle``. Where an environment gives
    no value, it is missing: NaN, -1, 0 (unsigned), False or ``""``. What resets give and steps never do holds for the episode.
    A reset of all environments makes the arrays anew; steps, and resets with a mask, write into them.
    """

    def __init__(self, env_fns: Sequence[Callable[[], Any]]) -> None:
        self.envs: list[Any] = [make() for make in env_fns]
        if not self.envs:
            raise ValueError("EnvPool needs at least one environment; give a list of functions that make one each")
        for env in self.envs:
            require_spaces(env)
        self.seeds: npt.NDArray[np.int64] = np.zeros(len(self.envs), np.int64)
        # Whether their last reset had one.
        self.seeded: npt.NDArray[np.bool_] = np.zeros(len(self.envs), np.bool_)
        # Made once: a space that is made at every access begins its random numbers anew.
        self._action_space: gym.Space[Any] = batch_space(self.envs[0].action_space, len(self.envs))
        self._observation_space: gym.Space[Any] = batch_space(self.envs[0].observation_space, len(self.envs))
        #: The infos, and what each environment gave last.
        self.table: Table = Table(len(self.envs), frozenset[str]().union(*map(_observed, self.envs)))
        # Whose episode is over; None before the first reset.
        self._over: npt.NDArray[np.bool_] | None = None

    @property
    def num_envs(self) -> int:
        """Number of environments."""
        return len(self.envs)

    @property
    def single_action_space(self) -> gym.Space[Any]:
        """The space of one environment's action."""
        return self.envs[0].action_space

    @property
    def action_space(self) -> gym.Space[Any]:
        """The space of all environments' actions, ``(N, …)``."""
        return self._action_space

    @property
    def single_observation_space(self) -> gym.Space[Any]:
        """The space of one environment's observation."""
        return self.envs[0].observation_space

    @property
    def observation_space(self) -> gym.Space[Any]:
        """The space of all environments' observations."""
        return self._observation_space

    @property
    def variation_space(self) -> Any:
        """The factors of variation of the first environment; None if it has none."""
        return getattr(self.envs[0].unwrapped, "variation_space", None)

    @property
    def single_variation_space(self) -> Any:
        """As ``variation_space``."""
        return self.variation_space

    def reset(
        self,
        seed: int | Sequence[int | None] | npt.NDArray[np.integer[Any]] | None = None,
        options: Mapping[str, Any] | Sequence[Mapping[str, Any] | None] | None = None,
        mask: Mask | None = None,
    ) -> tuple[None, dict[str, Any]]:
        """Reset all environments, or those that ``mask`` ``(N,)`` chooses.

        Args:
            seed: A number (environment ``i`` gets ``seed + i``), a list of N, or None.
            options: A dict for all, or a list of N.
            mask: Which environments to reset; the others keep their infos.
        """
        seeds = _broadcast_arg(seed, self.num_envs, increment=True)
        each = _broadcast_arg(options, self.num_envs)
        infos: list[dict[str, Any] | None] = [None] * self.num_envs
        for row, env in enumerate(self.envs):
            if mask is None or mask[row]:
                _, infos[row] = returned(env, "reset", env.reset(seed=seeds[row], options=each[row]))
                self.seeded[row] = seeds[row] is not None
                if seeds[row] is not None:
                    self.seeds[row] = seeds[row]
        if mask is None or self._over is None:
            self._over = np.zeros(self.num_envs, np.bool_)
            self.table.begin([info or {} for info in infos])
        else:
            for row, info in enumerate(infos):
                if info is not None:
                    self.table.write(row, info, is_step=False)
                    self._over[row] = False
        return None, self.table.columns

    def step(
        self, actions: Any, mask: Mask | None = None
    ) -> tuple[None, npt.NDArray[np.float32], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Step the environments whose episode is not over, or those of them that ``mask`` chooses.

        The others have reward 0 and keep their infos.

        Args:
            actions: ``(N, *A)``, or what the space of all environments' actions has: a dict of arrays of a dict of spaces.
            mask: ``(N,)``.

        Returns:
            None, rewards f32 ``(N,)``, terminations and truncations bool ``(N,)``, and the infos.

        Raises:
            AttributeError: No episode has begun.
            SwmError: The episodes of all environments that would step are over.
        """
        if self._over is None:
            # The class of the reference, which cannot step then either.
            raise AttributeError("no episode has begun; call `reset` before the next step")
        chosen = np.ones(self.num_envs, np.bool_) if mask is None else np.asarray(mask, np.bool_)
        if chosen.any() and not (chosen & ~self._over).any():
            raise _swm.EnvError(
                "the episodes of all environments that it would step are over; call `reset` before the next step"
            )
        each = self._each(actions)
        rewards = np.zeros(self.num_envs, np.float32)
        terminateds = np.zeros(self.num_envs, np.bool_)
        truncateds = np.zeros(self.num_envs, np.bool_)
        for row in map(int, np.flatnonzero(chosen & ~self._over)):
            env = self.envs[row]
            _, rewards[row], terminateds[row], truncateds[row], info = returned(env, "step", env.step(each[row]))
            self._over[row] = terminateds[row] or truncateds[row]
            self.table.write(row, info, is_step=True)
        return None, rewards, terminateds, truncateds, self.table.columns

    def _each(self, actions: Any) -> Sequence[Any]:
        """The actions, one for each environment."""
        if isinstance(self._action_space, (gym.spaces.Dict, gym.spaces.Tuple)):
            return list(iterate(cast("Any", self._action_space), actions))
        found: tuple[int, ...] = tuple(getattr(actions, "shape", None) or np.shape(actions))
        if not found or found[0] != self.num_envs:
            wanted = (self.num_envs, *(self.single_action_space.shape or ()))
            raise ValueError(
                f"actions has the shape {found}, and {wanted} is needed: one row for each of the {self.num_envs} environments"
            )
        return actions

    def close(self) -> None:
        """Close all environments."""
        for env in self.envs:
            env.close()


def require_spaces(env: Any) -> None:
    """Refuses what is no environment.

    Raises:
        TypeError: It is None, or lacks a space.
    """
    if env is None:
        raise TypeError("a function that makes an environment returned None; end it with `return`")
    for name, example in (("observation_space", "Box(-1, 1, (4,))"), ("action_space", "Discrete(2)")):
        if not isinstance(space := getattr(env, name, None), gym.Space):
            raise TypeError(f"{_shown(env)}: `{name}` is {kind_of(space)}; set it to a space, such as gymnasium.spaces.{example}")


def returned(env: Any, method: str, values: Any) -> Any:
    """What ``reset`` or ``step`` of an environment returned.

    Raises:
        TypeError: It is not what gymnasium's interface has; the message names the environment and the fix.
    """
    names = _RETURNS[method]
    is_several = isinstance(values, (tuple, list))
    count = len(cast("Sequence[Any]", values)) if is_several else 1
    if is_several and count == len(names) and isinstance(values[-1], Mapping):
        return values  # pyright: ignore[reportUnknownVariableType]
    found = f"{count} values" if is_several and count != len(names) else kind_of(values[-1]) + " as the info" if is_several else kind_of(values)
    fix = "; `done` of older interfaces is `terminated`, or `truncated` where a limit of steps ends the episode" if method == "step" and count == 4 else ""
    raise TypeError(f"`{method}` of {_shown(env)} returned {found}; return {', '.join(names)}, where info is a dict{fix}")


def _shown(env: Any) -> str:
    return str(getattr(env, "unwrapped", env))


def _stack_fresh(  # pyright: ignore[reportUnusedFunction]
    per_env_infos: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """Infos of all environments as one table, by the reference's name."""
    table = Table(len(per_env_infos))
    table.begin(per_env_infos)
    return table.columns


def _write_env_info(  # pyright: ignore[reportUnusedFunction]
    stacked: dict[str, Any], idx: int, info: Mapping[str, Any]
) -> None:
    """Write one environment's infos into a table, by the reference's name; names that it lacks are left out."""
    known = {name: value for name, value in info.items() if name in stacked}
    if known:
        Table(len(stacked[next(iter(known))]), columns=stacked).put(idx, known)


def _observed(env: Any) -> frozenset[str]:
    """The names of an environment's observations, if one of the wrappers around it has them."""
    while env is not None:
        if isinstance(names := getattr(env, "observed", None), frozenset):
            return cast("frozenset[str]", names)
        env = getattr(env, "env", None)
    return frozenset()


def _broadcast_arg(arg: Any, n: int, increment: bool = False) -> list[Any]:
    """One argument per environment; ``increment`` counts up from a number."""
    if isinstance(arg, list):
        return arg  # pyright: ignore[reportUnknownVariableType]
    if isinstance(arg, (tuple, np.ndarray)):
        return list(arg)  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]
    if increment and isinstance(arg, (int, np.integer)):
        first = int(arg)  # pyright: ignore[reportUnknownArgumentType]  of any width
        return [first + row for row in range(n)]
    return [arg] * n

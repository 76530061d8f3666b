"""`EnvPool`: environments that are Python objects, stepped one after the other.

For environments of gymnasium that this package does not have. The package's own run in Rust, in a `NativePool` with the
same methods; `World` picks the right one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector.utils import batch_space

__all__ = ["EnvPool"]

Mask = Sequence[bool] | npt.NDArray[np.bool_]


class EnvPool:
    """Environments with one interface and one table of infos.

    Args:
        env_fns: One function per environment, which makes it.

    The infos are a dict. Arrays, tensors and numbers are stacked to ``(N, 1, …)``; other values are lists of lists
    ``[N][1]``. A reset of all environments makes the arrays anew; steps, and resets with a mask, write into them.
    """

    def __init__(self, env_fns: Sequence[Callable[[], Any]]) -> None:
        self.envs: list[Any] = [make() for make in env_fns]
        if not self.envs:
            raise ValueError("EnvPool needs at least one environment; give a list of functions that make one each")
        self.seeds: npt.NDArray[np.int64] = np.zeros(len(self.envs), np.int64)
        # Whether their last reset had one.
        self.seeded: npt.NDArray[np.bool_] = np.zeros(len(self.envs), np.bool_)
        # Made once: a space that is made at every access begins its random numbers anew.
        self._action_space: gym.Space[Any] = batch_space(self.envs[0].action_space, len(self.envs))
        self._observation_space: gym.Space[Any] = batch_space(self.envs[0].observation_space, len(self.envs))
        self._stacked_infos: dict[str, Any] | None = None

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
                _, infos[row] = env.reset(seed=seeds[row], options=each[row])
                self.seeded[row] = seeds[row] is not None
                if seeds[row] is not None:
                    self.seeds[row] = seeds[row]
        if mask is None or self._stacked_infos is None:
            self._stacked_infos = _stack_fresh([info for info in infos if info is not None])
        else:
            for row, info in enumerate(infos):
                if info is not None:
                    _write_env_info(self._stacked_infos, row, info)
        return None, self._stacked_infos

    def step(
        self, actions: Any, mask: Mask | None = None
    ) -> tuple[None, npt.NDArray[np.float32], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Step all environments, or those that ``mask`` chooses; the others have reward 0 and keep their infos.

        Args:
            actions: ``(N, *A)``.
            mask: ``(N,)``.

        Returns:
            None, rewards f32 ``(N,)``, terminations and truncations bool ``(N,)``, and the infos.
        """
        if self._stacked_infos is None:
            raise AttributeError("no episode has begun; call `reset` before the first step")
        found: tuple[int, ...] = tuple(getattr(actions, "shape", None) or np.shape(actions))
        if not found or found[0] != self.num_envs:
            wanted = (self.num_envs, *(self.single_action_space.shape or ()))
            raise ValueError(
                f"actions has the shape {found}, and {wanted} is needed: one row for each of the {self.num_envs} environments"
            )
        rewards = np.zeros(self.num_envs, np.float32)
        terminateds = np.zeros(self.num_envs, np.bool_)
        truncateds = np.zeros(self.num_envs, np.bool_)
        for row, env in enumerate(self.envs):
            if mask is None or mask[row]:
                _, rewards[row], terminateds[row], truncateds[row], info = env.step(actions[row])
                _write_env_info(self._stacked_infos, row, info)
        return None, rewards, terminateds, truncateds, self._stacked_infos

    def close(self) -> None:
        """Close all environments."""
        for env in self.envs:
            env.close()


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


def _is_tensor(value: Any) -> bool:
    """Whether a value is a torch tensor, without importing torch."""
    return type(value).__module__.partition(".")[0] == "torch" and hasattr(value, "unsqueeze")


def _stack_fresh(per_env_infos: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Infos of all environments as one table ``(N, 1, …)``."""
    stacked: dict[str, Any] = {}
    for name, first in per_env_infos[0].items():
        values = [info[name] for info in per_env_infos]
        shapes = [getattr(value, "shape", None) for value in values]
        for row, shape in enumerate(shapes):
            if shape != shapes[0] and isinstance(first, np.ndarray):
                raise ValueError(
                    f"`{name}` has the shape {shapes[0]} in environment 0 and {shape} in environment {row}; environments of one World "
                    "give it the same shape, or leave it out"
                )
        if _is_tensor(first):
            import torch

            stacked[name] = torch.stack(values).unsqueeze(1)
        elif isinstance(first, np.ndarray):
            stacked[name] = np.stack(values)[:, None]
        elif isinstance(first, (bool, int, float, np.generic)):
            stacked[name] = np.array(values)[:, None]
        else:
            stacked[name] = [[value] for value in values]
    return stacked


def _write_env_info(stacked: dict[str, Any], idx: int, info: Mapping[str, Any]) -> None:
    """Write one environment's infos into the table; names that it lacks are left out."""
    for name, value in info.items():
        column = stacked.get(name)
        if column is None:
            continue
        if isinstance(column, list):
            column[idx][0] = value
            continue
        try:
            column[idx, 0] = column.new_tensor(value) if _is_tensor(column) and not _is_tensor(value) else value
        except (ValueError, TypeError, RuntimeError) as error:
            found = tuple(getattr(value, "shape", None) or np.shape(value))
            raise ValueError(
                f"`{name}` of environment {idx} has the shape {found}, and had {tuple(column.shape[2:])} when the environments were reset; "
                "give it the same shape at every step"
            ) from error

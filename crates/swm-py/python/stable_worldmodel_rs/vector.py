"""`VectorEnv`: many environments of this package in one World, as gymnasium's interface for vectors has them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from ._core import core as _swm
from .envs.env import make_core
from . import spaces
from .envs.observed import Goals, Observed, goals_of
from .world.native import NativePool

__all__ = ["VectorEnv"]

Observations = dict[str, npt.NDArray[Any]]
Flags = npt.NDArray[np.bool_]
_RESULTS = frozenset({"reward", "terminated", "truncated"})


class VectorEnv(gym.vector.VectorEnv[Observations, npt.NDArray[Any], npt.NDArray[Any]]):
    """Environments stepped together in Rust, made by ``gymnasium.make_vec("swm/PushT-v1", num_envs=8)``.

    Observations are a dict of step columns ``(N, …)``; infos hold the rest ``(N, …)``, each with its mask ``_name``.
    ``reset(seed=s)`` begins episode ``i`` of run ``s`` in environment ``i``, as ``World.reset(seed=s)`` does; a list of
    seeds names the episodes' own seeds.

    Args:
        env_name: ``"swm/PushT-v1"``.
        num_envs: Environments side by side.
        max_episode_steps: Steps after which an episode is truncated; None: never.
        image_shape: (height, width) of ``pixels``; None: observations have no images.
        render_mode: ``"rgb_array"`` for ``render()``.
        autoreset_mode: ``NEXT_STEP`` (an environment whose episode is over ignores its next action and resets),
            ``SAME_STEP`` (it resets at once; ``final_obs`` and ``final_info`` hold how it ended) or ``DISABLED``
            (call ``reset(options={"reset_mask": mask})``).
        copy: False: observations are read-only views, which the next step overwrites.
        threads: Threads; None: one per core. Results do not depend on it.
        frame_skip: How often each action is applied per step.
        render: ``"exact"`` or ``"fast"``.
        goals: Observations for goals, as of `Env`.
        **settings: Settings of the environments.

    Example:
        >>> envs = gymnasium.make_vec("swm/PushT-v1", num_envs=8, max_episode_steps=100)
        >>> observations, infos = envs.reset(seed=0)
        >>> observations["state"].shape
        (8, 7)
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        env_name: str,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        image_shape: tuple[int, int] | None = None,
        render_mode: str | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        threads: int | None = None,
        frame_skip: int = 1,
        render: str = "exact",
        goals: bool | Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        self.pool: NativePool = make_core(
            type(self), env_name, num_envs, image_shape, render_mode, max_episode_steps, frame_skip, threads, render, settings
        )
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode: AutoresetMode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self._copy = copy
        self._hides_image = image_shape is None
        self.single_action_space: gym.Space[Any] = self.pool.single_action_space
        self.action_space: gym.Space[Any] = self.pool.action_space
        self.goals: Goals | None = goals_of(self.pool.spec_data, goals)
        if self.goals is not None:
            self.compute_reward: Callable[..., Any] = self.goals.compute_reward
        self._observed: Observed = Observed(self.pool, self._hides_image, self.goals)
        self.single_observation_space: gym.Space[Any] = self._observed.space
        self.observation_space: gym.Space[Any] = batch_space(self._observed.space, num_envs)
        self._over: Flags = np.zeros(num_envs, np.bool_)

    @property
    def variation_space(self) -> spaces.Dict:
        """The factors of variation, with the values of the first environment."""
        return self.pool.variation_space

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | list[dict[str, Any] | None] | None = None,
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin episodes in all environments, or in those that ``options["reset_mask"]`` ``(N,)`` chooses.

        Args:
            seed: The seed of a run, or a list of N seeds of episodes.
            options: As of `Env.reset`, or a list of N.
        """
        super().reset(seed=seed if isinstance(seed, int) else None)
        mask: Flags | None = None
        if isinstance(options, dict) and "reset_mask" in options:
            mask = self._mask(options["reset_mask"])
            options = {name: value for name, value in options.items() if name != "reset_mask"}
        self.pool.reset(seed=seed, options=options, mask=mask)
        if mask is None:
            self._over[:] = False
        else:
            self._over[mask] = False
        return self._observations(), self._infos()

    def _mask(self, given: Any) -> Flags:
        mask = np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise _swm.SwmError(
                f"reset_mask must be a boolean array of shape ({self.num_envs},) with a True in it, "
                f"found {mask.dtype} of shape {mask.shape}"
            )
        return mask

    def step(self, actions: Any) -> tuple[Observations, npt.NDArray[np.float64], Flags, Flags, dict[str, Any]]:
        """Step with ``actions`` ``(N, *A)``; which environments reset by themselves, ``autoreset_mode`` says."""
        restarts = self._over.copy()
        if self.autoreset_mode is AutoresetMode.DISABLED and restarts.any():
            rows = np.flatnonzero(restarts).tolist()
            raise _swm.SwmError(
                f"the episodes of the environments {rows} are over, and autoreset_mode is DISABLED; "
                'call reset(options={"reset_mask": mask}) for them'
            )
        if not restarts.all():
            # The core leaves environments alone whose episode is over.
            self.pool.core.step(actions)
        _, shown_terminateds, shown_truncateds = self.pool.results
        terminateds, truncateds = shown_terminateds & ~restarts, shown_truncateds & ~restarts
        # The column has the full precision, but keeps the last reward of episodes that are over.
        rewards: npt.NDArray[np.float64] = np.where(restarts, 0.0, self._rewards())
        self._over = terminateds | truncateds
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and restarts.any():
            self.pool.reset(mask=restarts)
        elif self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            final = self._final()
            self.pool.reset(mask=self._over)
            infos = {**self._infos(), **final}
            self._over = np.zeros(self.num_envs, np.bool_)
            return self._observations(), rewards, terminateds, truncateds, infos
        return self._observations(), rewards, terminateds, truncateds, self._infos()

    def _final(self) -> dict[str, Any]:
        """How the episodes ended that are over: observations one by one, infos together, and who they are of."""
        over = self._over.copy()
        observations = np.full(self.num_envs, None, object)
        values = self._observed.values(self.pool)
        for row in np.flatnonzero(over):
            observations[row] = {name: column[row].copy() for name, column in values.items()}
        infos = self._infos()
        infos.update({name: over for name in infos if name.startswith("_")})
        return {"final_obs": observations, "_final_obs": over, "final_info": infos, "_final_info": over}

    def _observations(self) -> Observations:
        return {name: self._all(values) for name, values in self._observed.values(self.pool).items()}

    def _rewards(self) -> npt.NDArray[np.float64]:
        if self.goals is None:
            return self.pool.raw("reward")[:, 0]
        values = self._observed.values(self.pool)
        return self.goals.reward(values["achieved_goal"], values["desired_goal"])

    def _infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        there = np.ones(self.num_envs, np.bool_)
        for name, column in self.pool.infos.items():
            if name in self._observed or name in _RESULTS or (self._hides_image and name in ("pixels", "goal")):
                continue
            infos[name] = (
                np.array([row[0] for row in cast("list[list[Any]]", column)], object)
                if isinstance(column, list)
                else self._all(column[:, 0])
            )
            infos[f"_{name}"] = there
        if self.goals is not None:
            values = self._observed.values(self.pool)
            infos["is_success"] = self.goals.is_success(values["achieved_goal"], values["desired_goal"])
            infos["_is_success"] = there
        return infos

    def _all(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return values.copy() if self._copy else values

    def render(self) -> tuple[npt.NDArray[np.uint8], ...] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """One image ``(H, W, 3)`` per environment; None without ``render_mode="rgb_array"``."""
        if self.render_mode is None:
            return None
        return tuple(image.copy() for image in self.pool.raw("pixels")[:, 0])

    def close_extras(self, **kwargs: Any) -> None:
        """Free the environments."""
        self.pool.close()

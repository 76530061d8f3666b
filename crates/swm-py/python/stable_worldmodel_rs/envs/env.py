"""`Env`: one environment of this package, as gymnasium's interface has it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from .. import spaces
from .._core import core as _swm
from ..world.ids import native_env
from ..world.native import NativePool, checked_shape, make_native
from .observed import Goals, Observed, goals_of

__all__ = ["Env", "make_core"]

Observation = dict[str, npt.NDArray[Any]]
# What `render` shows where no size is given, as in the reference.
DEFAULT_IMAGE = (224, 224)
# Columns that gymnasium returns by themselves.
_RESULTS = frozenset({"reward", "terminated", "truncated"})


def make_core(
    of: Callable[..., Any],
    env_name: str,
    num_envs: int,
    image_shape: tuple[int, int] | None,
    render_mode: str | None,
    max_episode_steps: int | None,
    frame_skip: int,
    threads: int | None,
    render: str,
    settings: dict[str, Any],
) -> NativePool:
    """The environments behind an `Env` or a `VectorEnv`."""
    if render_mode not in (None, "rgb_array"):
        raise _swm.SwmError(f"render_mode: {render_mode!r} is not available; use 'rgb_array', or None for no images")
    native, given = native_env(env_name, settings)
    image_shape = checked_shape(image_shape)
    if render_mode is not None and image_shape is None:
        image_shape = DEFAULT_IMAGE
    if render != "exact":
        given = {**given, "render": render}
    built: dict[str, Any] = {
        "id": native or env_name,
        "num_envs": num_envs,
        "image": image_shape,
        "max_episode_steps": max_episode_steps,
        "frame_skip": frame_skip,
        "threads": threads,
        "settings": json.dumps(dict(given)),
    }
    return NativePool(make_native(of, **built), built)


class Env(gym.Env[Observation, npt.NDArray[Any]]):
    """One environment, made by ``gymnasium.make("swm/PushT-v1", **settings)``.

    The observation is a dict of the environment's step columns (``state``, ``proprio``, … and ``pixels`` if
    ``image_shape`` is given; one number per step has the shape ``(1,)``); the info holds the rest: ``goal``, ``goal_state``,
    factors of variation, ``seed``, ``step_idx``, the last ``action``. All are copies, unless ``copy=False``.

    With ``goals`` the observation is ``observation``, ``achieved_goal`` and ``desired_goal``, and the reward
    ``compute_reward(achieved_goal, desired_goal, info)``, as hindsight experience replay needs it. The ids
    ``swm/Fetch…Dict-v3`` are so by default.

    ``copy.deepcopy`` and ``pickle`` make an environment that goes on alike from the same step.

    ``reset(seed=s)`` begins episode 0 of run ``s``, as ``World.reset(seed=s)`` does; later resets without a seed begin
    episodes 1, 2, … of that run.

    Args:
        env_name: ``"swm/PushT-v1"``.
        image_shape: (height, width) of ``pixels``; None: the observation has no image.
        render_mode: ``"rgb_array"`` for ``render()``; of 224 × 224 unless ``image_shape`` says otherwise.
        frame_skip: How often each action is applied per step.
        render: ``"exact"`` (the reference's images to the byte) or ``"fast"``.
        copy: False: observations and infos are read-only views, which the next step overwrites.
        goals: True (Fetch), or a dict with the arguments of `Goals`: ``observation``, ``achieved_goal``, ``desired_goal``,
            ``below``; also ``elements``, ``dense``. False: none. None: as the id has it.
        **settings: Settings of the environment; see ``envs.info("swm/PushT-v1")["settings"]``.

    Example:
        >>> env = gymnasium.make("swm/PushT-v1", image_shape=(64, 64))
        >>> observation, info = env.reset(seed=0)
        >>> observation["state"].shape, observation["pixels"].shape, info["goal"].shape
        ((7,), (64, 64, 3), (64, 64, 3))
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        env_name: str,
        *,
        image_shape: tuple[int, int] | None = None,
        render_mode: str | None = None,
        frame_skip: int = 1,
        render: str = "exact",
        copy: bool = True,
        goals: bool | Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        self.pool: NativePool = make_core(
            type(self), env_name, 1, image_shape, render_mode, None, frame_skip, 1, render, settings
        )
        self.render_mode = render_mode
        self._hides_image = image_shape is None
        self._copy = copy
        self.action_space: gym.Space[npt.NDArray[Any]] = self.pool.single_action_space
        self.goals: Goals | None = goals_of(self.pool.spec_data, goals)
        if self.goals is not None:
            # Libraries take an environment with this attribute for one with goals.
            self.compute_reward: Callable[..., Any] = self.goals.compute_reward
        self._observed: Observed = Observed(self.pool, self._hides_image, self.goals)
        self.observation_space: gym.Space[Observation] = cast("gym.Space[Observation]", self._observed.space)
        self.metadata = {**self.metadata, "render_fps": round(1 / (self.pool.spec_data["time_step_s"] * frame_skip))}

    @property
    def variation_space(self) -> spaces.Dict:
        """The factors of variation, with the values of the present episode."""
        return self.pool.variation_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: The seed of the run.
            options: ``variation`` (factors to sample: names, groups, ``"all"``), ``variation_values``, ``state``,
                ``goal_state``, or ``start`` and ``goal`` with columns of a recorded row.
        """
        super().reset(seed=None if seed is None else int(seed))
        self.pool.reset(seed=seed, options=options)
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take one step with ``action`` ``(*A)``.

        Raises:
            SwmError: No episode has begun, or it is over; or the action is none of the action space.
        """
        _, terminateds, truncateds = self.pool.results
        self.pool.core.step(np.asarray(action)[None])
        # The column has the full precision.
        reward = float(self.pool.raw("reward")[0, 0])
        observation, info = self._observation(), self._info()
        if self.goals is not None:
            reward = float(self.goals.reward(observation["achieved_goal"], observation["desired_goal"]))
            info["is_success"] = bool(self.goals.is_success(observation["achieved_goal"], observation["desired_goal"]))
        return observation, reward, bool(terminateds[0]), bool(truncateds[0]), info

    def _observation(self) -> Observation:
        return {name: self._one(values) for name, values in self._observed.values(self.pool).items()}

    def _info(self) -> dict[str, Any]:
        info: dict[str, Any] = {}
        for name, column in self.pool.infos.items():
            if name in self._observed or name in _RESULTS or (self._hides_image and name in ("pixels", "goal")):
                continue
            info[name] = cast("list[list[Any]]", column)[0][0] if isinstance(column, list) else self._one(column[:, 0])
        return info

    def _one(self, column: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The values of the environment, of ``(1, …)``, as an array even where it is a number."""
        values = column[0, ...]
        return values.copy() if self._copy else values

    def render(self) -> npt.NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The image of the present step, ``(H, W, 3)``; None without ``render_mode="rgb_array"``."""
        if self.render_mode is None:
            return None
        return self.pool.raw("pixels")[0, 0].copy()

    def close(self) -> None:
        """Free the environment."""
        self.pool.close()

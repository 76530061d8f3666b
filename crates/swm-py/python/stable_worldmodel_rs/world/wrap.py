"""Environments of gymnasium behind a `World`: everything they say is put into the infos, with images of one size."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, TypeGuard, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from .columns import flat, is_array, missing
from .env_pool import EnvPool, require_spaces, returned
from .ids import nearest_id
from .native import nearest_argument, variation_names

Image = npt.NDArray[np.uint8]
Transform = Callable[[Any], Any]
_SIZE_OF = {"nearest": 0, "bilinear": 1, 0: 0, 1: 1}
# PIL's number of bilinear resampling.
_BILINEAR = {None: 1, 2: 1}


def make_pool(
    of: Callable[..., Any],
    env_name: str | Sequence[Callable[[], Any]],
    num_envs: int,
    image_shape: tuple[int, int] | None,
    max_episode_steps: int | None,
    pre_wrappers: Sequence[Callable[[Any], Any]],
    extra_wrappers: Sequence[Callable[[Any], Any]],
    image_transform: Transform | None,
    goal_transform: Transform | None,
    goal_conditioned: bool,
    image_resample: str | int | None,
    settings: dict[str, Any],
) -> EnvPool:
    """Make the environments of a World, of an id by ``gymnasium.make`` or by given functions, with complete infos.

    An environment that a function made keeps its own limit of steps, and one with an `InfoWrapper` stays as it is. A setting that the
    environment does not know and that is near an argument of ``of`` is one that the user meant.
    """
    inner = partial(
        InfoWrapper,
        image_shape=image_shape,
        image_transform=image_transform,
        goal_transform=goal_transform,
        goal_conditioned=goal_conditioned,
        resample=image_resample,
    )

    def complete(env: Any) -> Any:
        for wrapper in (*pre_wrappers, inner, *extra_wrappers):
            env = wrapper(env)
        return env

    def of_id(name: str) -> Any:
        given = dict(settings)
        if image_shape is not None:
            given.setdefault("render_mode", "rgb_array")
        try:
            return complete(gym.make(name, max_episode_steps=max_episode_steps, **given))
        except gym.error.UnregisteredEnv as error:
            near = nearest_id(name)
            if near is None:
                raise type(error)(f"{error} This package's environments are listed by `swm.envs.WORLDS`, such as swm/PushT-v1.") from None
            raise type(error)(f"{name!r} is no environment of this package, nor of gymnasium; did you mean {near!r}? gymnasium says: {error}") from None
        except TypeError as error:
            wrong = next((given for given in settings if f"'{given}'" in str(error)), "")
            if (near := nearest_argument(of, wrong)) is None:
                raise
            raise TypeError(f"{error}; did you mean {near}=?") from None

    def of_function(make: Callable[[], Any]) -> Any:
        env: Any = make()
        if not _is_env(env) or _is_complete(env):
            return env
        require_spaces(env)
        env = _Interface(env)
        has_limit = env.spec is not None and env.spec.max_episode_steps is not None
        if max_episode_steps is not None and not has_limit:
            env = gym.wrappers.TimeLimit(env, max_episode_steps)
        return complete(env)

    if isinstance(env_name, str):
        return EnvPool([partial(of_id, env_name)] * num_envs)
    return EnvPool([partial(of_function, make) for make in env_name])


def _is_env(env: object) -> TypeGuard[gym.Env[Any, Any]]:
    """Whether gymnasium knows this kind of environment."""
    return isinstance(env, gym.Env)


def _is_wrapper(env: object) -> TypeGuard[gym.Wrapper[Any, Any, Any, Any]]:
    """Whether there is another environment within this one."""
    return isinstance(env, gym.Wrapper)


def _is_complete(env: Any) -> bool:
    """Whether one of the wrappers around an environment completes its infos."""
    while _is_wrapper(env):
        if isinstance(env, InfoWrapper):
            return True
        env = env.env
    return False


class _Interface(gym.Wrapper[Any, Any, Any, Any]):
    """Refuses an older interface than gymnasium's: wrappers around it would say that values are missing."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As of the environment."""
        try:
            values = self.env.reset(seed=seed, options=options)
        except TypeError as error:
            if "unexpected keyword argument 'seed'" in str(error) or "unexpected keyword argument 'options'" in str(error):
                raise TypeError(f"{error}, of {self.env.unwrapped}: define reset(self, *, seed=None, options=None)") from error
            raise
        return returned(self.env, "reset", values)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """As of the environment."""
        return returned(self.env, "step", self.env.step(action))


class InfoWrapper(gym.Wrapper[Any, Any, Any, Any]):
    """Puts observation, reward, ends, action, step and image of every step into the info.

    Observations that are no dict are named ``observation``; the image is ``pixels``, ``(H, W, 3)`` u8 before the
    transform. The action of a reset is NaN (-1 for integers).

    Raises:
        ValueError: An observation lacks an entry that the reset's had, or what is rendered is no image.
    """

    def __init__(
        self,
        env: Any,
        image_shape: tuple[int, int] | None = None,
        image_transform: Transform | None = None,
        goal_transform: Transform | None = None,
        goal_conditioned: bool = True,
        resample: str | int | None = None,
    ) -> None:
        super().__init__(env)
        self._image_shape = image_shape
        self._transforms = {"pixels": image_transform, "goal": goal_transform}
        self._goal_conditioned = goal_conditioned
        self._resample = resample
        self._step = 0
        self._id = 0
        self._watched: tuple[str, ...] = ()
        #: Names of the observations, as the space has them.
        self.observed: frozenset[str] = frozenset(_names(env.observation_space))
        # Those that the last reset gave.
        self._promised: frozenset[str] = frozenset()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._step = 0
        self._id = int(self.env.unwrapped.np_random.integers(0, np.iinfo(np.int64).max))
        if options and (names := variation_names(options)) is not None:
            self._watched = tuple(self._variations().names()) if names == ["all"] else tuple(names)
        self._promised = frozenset()
        action = {name: missing(part) for name, part in self._actions(self.env.action_space.sample()).items()}
        info = self._complete(info, observation, np.nan, False, False, action)
        self._promised = frozenset(flat(_named(observation)))
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step, and complete the info."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._step += 1
        taken = self._actions(action)
        info = self._complete(info, observation, float(reward), bool(terminated), bool(truncated), taken)
        return observation, float(reward), bool(terminated), bool(truncated), info

    def _variations(self) -> Any:
        return self.env.unwrapped.variation_space  # type: ignore[attr-defined]

    def _actions(self, action: Any) -> dict[str, Any]:
        """The columns of an action: ``action``, or ``action.<name>`` of a dict, of the space's type where that holds it."""
        dtype = getattr(self.env.action_space, "dtype", None)
        parts = flat({"action": action})
        array: Any = parts.get("action")
        if is_array(array) and dtype is not None and np.can_cast(array.dtype, dtype, "same_kind"):
            parts["action"] = array.astype(dtype)
        return parts

    def _complete(
        self, info: dict[str, Any], observation: Any, reward: float, terminated: bool, truncated: bool, action: dict[str, Any]
    ) -> dict[str, Any]:
        told = dict(info)
        told.update(_named(observation))
        if self._promised and (lacking := sorted(self._promised.difference(flat(told)))):
            raise ValueError(
                f"the observation of {self.env.unwrapped} lacks `{lacking[0]}` at step {self._step}, and had it when it was reset; "
                "return every entry of the observation space at every step, and put what comes and goes into the info"
            )
        told.update(
            action, reward=reward, terminated=terminated, truncated=truncated, step_idx=self._step, id=self._id
        )
        for name in self._watched:
            space = self._variations()
            for part in name.split("."):
                space = space[part]
            told[f"variation.{name}"] = space.value
        if self._image_shape is not None:
            image = self.env.render()
            if image is None:
                raise ValueError(
                    f"{self.env.unwrapped} renders no image; make it with render_mode='rgb_array', or the World with "
                    "add_pixels=False"
                )
            told["pixels"] = self._image("pixels", image)
            if "goal" in told and not isinstance(told["goal"], dict):
                told["goal"] = self._image("goal", told["goal"])
        if not self._goal_conditioned:
            told.pop("goal", None)
        return told

    def _image(self, name: str, image: Any) -> Any:
        image = np.asarray(image)
        assert self._image_shape is not None
        if image.ndim == 3 and image.dtype == np.uint8:
            image = resized(image, self._image_shape, self._resample)
        transform = self._transforms[name]
        if name == "pixels" and transform is None and (image.ndim != 3 or image.shape[2] not in (1, 3)):
            raise ValueError(
                f"{self.env.unwrapped} renders {image.dtype} of shape {list(image.shape)}, which is no image; render [H, W, 3]: of gray values [H, W] "
                "np.repeat(image[..., None], 3, axis=2), of RGBA image[..., :3]; or give image_transform="
            )
        # Of its own: the environment may show it again.
        return image if transform is None else transform(image.copy())


def _named(observation: Any) -> dict[str, Any]:
    """An observation by names."""
    return cast("dict[str, Any]", observation) if isinstance(observation, dict) else {"observation": observation}


def _names(space: Any, prefix: str = "") -> Iterator[str]:
    """Names of the observations of a space, those of dicts and of the spaces within both."""
    inner = getattr(space, "spaces", None)
    if not prefix and not isinstance(inner, dict):
        prefix = "observation"
    if prefix:
        yield prefix
    parts = cast("dict[Any, Any]", inner).items() if isinstance(inner, dict) else enumerate(inner or ())
    for name, part in cast("Iterable[tuple[Any, Any]]", parts):
        yield from _names(part, f"{prefix}.{name}" if prefix else str(name))


def resized(image: Image, shape: tuple[int, int], resample: str | int | None = None) -> Image:
    """An image ``(H, W, C)`` at another size: by ``nearest``, or (default) linearly with as wide a filter as it takes.

    Raises:
        ValueError: Another method of resampling.
    """
    method = _BILINEAR.get(resample, _SIZE_OF.get(resample) if resample is not None else 1)  # type: ignore[arg-type]
    if method is None:
        raise ValueError(f"image_resample={resample!r}: images are resized by 'nearest' or 'bilinear'")
    if image.shape[:2] == tuple(shape):
        return image
    if method == 0:
        rows, columns = (_nearest(old, new) for old, new in zip(image.shape[:2], shape, strict=True))
        return np.ascontiguousarray(image[rows][:, columns])
    down, across = (_weights(old, new) for old, new in zip(image.shape[:2], shape, strict=True))
    mixed = np.einsum("yh,hwc,xw->yxc", down, image.astype(np.float32), across, optimize=True)
    return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


def _nearest(old: int, new: int) -> npt.NDArray[np.intp]:
    return np.minimum(((np.arange(new) + 0.5) * old / new).astype(np.intp), old - 1)


def _weights(old: int, new: int) -> npt.NDArray[np.float32]:
    """How much each of ``old`` pixels counts in each of ``new``: a triangle, as wide as the pixels lie apart."""
    scale = old / new
    width = max(scale, 1.0)
    centers = (np.arange(new) + 0.5) * scale
    distance = np.abs(np.arange(old)[None, :] + 0.5 - centers[:, None]) / width
    weights = np.maximum(0.0, 1.0 - distance)
    return (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)

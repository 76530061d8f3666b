"""`World`: many environments, one policy, and the runs of the two."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from types import TracebackType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from .._arguments import kind_of, names_of
from .._core import core as _swm
from .._requests import log_notes
from . import foreign
from .ids import explicit, native_env
from .native import NativePool, checked_shape, make_native, whole
from .policies import NativePolicy, as_actions, as_policy, ask, describe, explains_actions
from .results import html_image, html_table
from .rows import apply_callables as _apply_callables
from .rows import extract_init_goal as _extract_init_goal
from .runs import Runs

if TYPE_CHECKING:
    from ..ui import Page

__all__ = ["World", "_apply_callables", "_extract_init_goal"]

logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")

Flags = npt.NDArray[np.bool_]
# The first this many environments are shown in notebooks.
_SHOWN = 16


class World(Runs):
    """Environments stepped together, a policy, and what comes of the two: datasets and results.

    ``copy.deepcopy`` and ``pickle`` make a World whose episodes go on alike from the same step; a policy of the core begins anew
    in it, without what it remembered.

    Environments of this package run in Rust. Any other id of gymnasium, or a list of functions that make
    environments, runs in Python in an `EnvPool`.

    Args:
        env_name: ``"swm/PushT-v1"``, an id of gymnasium, or a list of functions, one for each
            environment.
        num_envs: Environments side by side. Results do not depend on it.
        image_shape: (height, width) of the images; needed unless ``add_pixels=False``.
        max_episode_steps: Steps after which an episode is truncated; None: never. The command `swm eval` has 200 (``--budget``).
        goal_conditioned: Whether the infos hold the goal image.
        image_transform: Applied to each image of the infos ``(H, W, 3)`` before the policy sees it.
        goal_transform: The same for goal images.
        image_resample: How images of other environments are resized; those of this package are rendered at their size.
        add_pixels: Whether there are images.
        frame_skip: How often each action is applied per step.
        threads: Threads; None: one per core. Results do not depend on it.
        render: ``"exact"`` (the reference's images to the byte) or ``"fast"``.
        distractors: What changes the images, such as ``["color:0.3"]``.
        unrecorded: Columns that datasets do without.
        checkpoints: Save simulator states every so many steps; see ``collect(replayable=)``.
        **kwargs: Settings of the environment.

    Attributes:
        infos: A dict of arrays ``(N, 1, …)``, written in place by every reset and step: ``pixels`` and ``goal`` u8
            ``(N, 1, H, W, 3)``, ``state`` f64, ``action`` f32 (the last one taken; NaN after a reset), ``reward``,
            ``terminated``, ``truncated``, ``step_idx``, ``seed``, ``id``, … They are read-only where the environments run in
            Rust. Copy what you keep. A policy gets copies, which it may keep and change.
        rewards, terminateds, truncateds: Of the last step, ``(N,)``.

    Example:
        >>> world = World("swm/PushT-v1", num_envs=2, image_shape=(64, 64), threads=1)
        >>> world.set_policy("random")
        >>> world.evaluate(episodes=4, seed=42, progress=False)["episodes"]
        4
    """

    _stale = False
    _rewards: npt.NDArray[np.float32] | None = None
    _terminateds: Flags | None = None
    _truncateds: Flags | None = None
    _transforms: dict[str, Callable[[Any], Any]] = {}

    def __init__(
        self,
        env_name: str | Sequence[Callable[[], Any]],
        num_envs: int = 1,
        image_shape: tuple[int, int] | None = None,
        max_episode_steps: int | None = 100,
        goal_conditioned: bool = True,
        pre_wrappers: Sequence[Callable[[Any], Any]] | None = None,
        extra_wrappers: Sequence[Callable[[Any], Any]] | None = None,
        image_transform: Callable[[Any], Any] | None = None,
        goal_transform: Callable[[Any], Any] | None = None,
        image_resample: str | int | None = None,
        add_pixels: bool = True,
        *,
        frame_skip: int = 1,
        threads: int | None = None,
        render: str = "exact",
        distractors: Sequence[str] = (),
        unrecorded: Sequence[str] = (),
        checkpoints: int | None = None,
        **kwargs: Any,
    ) -> None:
        self.policy: Any = None
        self.infos: dict[str, Any] = {}
        image_shape = checked_shape(image_shape)
        if not isinstance(cast("Any", num_envs), (int, np.integer)):
            raise TypeError(f"num_envs={num_envs!r}; give a whole number")
        if num_envs < 1:
            raise _swm.EnvError(f"num_envs={num_envs}; give 1 or more")
        if isinstance(env_name, str):
            native, settings = native_env(env_name, kwargs)
        else:
            native, settings = None, kwargs
            if isinstance(cast("Any", env_name), (Mapping, bytes)) or not hasattr(env_name, "__iter__"):
                raise TypeError(
                    f"World was given {env_name!r}; give the id of an environment, such as 'swm/PushT-v1', or a list of functions that each make one: "
                    "[lambda: gymnasium.make('CartPole-v1')]"
                )
            env_name = list(env_name)
            _require_functions(env_name)
        # In gymnasium, -1 leaves out the limit that an id has.
        if max_episode_steps is not None and not (native is None and max_episode_steps == -1):
            max_episode_steps = whole("max_episode_steps", max_episode_steps, least=1)
        if native is None:
            from .wrap import make_pool

            self.envs: Any = make_pool(
                World,
                env_name,
                num_envs,
                image_shape=image_shape if add_pixels else None,
                max_episode_steps=max_episode_steps,
                pre_wrappers=pre_wrappers or (),
                extra_wrappers=extra_wrappers or (),
                image_transform=image_transform,
                goal_transform=goal_transform,
                goal_conditioned=goal_conditioned,
                image_resample=image_resample,
                settings=dict(settings),
            )
            if isinstance(env_name, str):
                _require_shape(image_shape, add_pixels)
            return
        if pre_wrappers or extra_wrappers:
            raise TypeError(
                f"`{env_name}` runs in Rust, where wrappers of gymnasium have no place: use distractors= for changed images, "
                "frame_skip= for repeated actions, image_transform= for what the policy sees, or gymnasium.make and a list of "
                "functions"
            )
        for name, value in (("frame_skip", frame_skip), ("threads", threads), ("checkpoints", checkpoints)):
            if value is not None:
                whole(name, value, 2**32 - 1, least=1)
        settings = dict(settings)
        settings.pop("render_mode", None)
        if render != "exact":
            settings["render"] = render
        if image_resample is not None:
            logger.info("image_resample: `%s` renders its images at their size, nothing is resized", env_name)
        self._built = {
            "id": native,
            "num_envs": num_envs,
            "image": image_shape if add_pixels else None,
            "max_episode_steps": max_episode_steps,
            "frame_skip": frame_skip,
            "threads": threads,
            "settings": json.dumps(settings, default=_plain),
            "unrecorded": list(unrecorded),
            "checkpoints": checkpoints,
        }
        self._core = make_native(World, **self._built)
        _require_shape(image_shape, add_pixels)
        transforms = {"pixels": image_transform, "goal": goal_transform}
        self._transforms = {name: transform for name, transform in transforms.items() if transform is not None}
        self.envs = NativePool(self._core, self._built, hidden=() if goal_conditioned else ("goal",))
        if distractors:
            self.envs.set_distractors(names_of(distractors) or ())
        self.infos = self.envs.infos

    @property
    def num_envs(self) -> int:
        """Number of environments."""
        return self.envs.num_envs

    @property
    def rewards(self) -> npt.NDArray[np.float32] | None:
        """Rewards of the last step, f32 ``(N,)``."""
        return self._fresh()._rewards

    @rewards.setter
    def rewards(self, values: npt.NDArray[np.float32] | None) -> None:
        self._rewards = values

    @property
    def terminateds(self) -> Flags | None:
        """Which environments the last step terminated, bool ``(N,)``."""
        return self._fresh()._terminateds

    @terminateds.setter
    def terminateds(self, values: Flags | None) -> None:
        self._terminateds = values

    @property
    def truncateds(self) -> Flags | None:
        """Which environments the last step truncated, bool ``(N,)``."""
        return self._fresh()._truncateds

    @truncateds.setter
    def truncateds(self, values: Flags | None) -> None:
        self._truncateds = values

    def _fresh(self) -> World:
        if self._stale:
            self._stale = False
            self._rewards, self._terminateds, self._truncateds = (values.copy() for values in self.envs.results)
        return self

    def set_policy(self, policy: Any, *, seed: int = 0) -> None:
        """Attach a policy.

        Args:
            policy: The name of a policy of the core with its arguments (``"expert"``, ``"cem:samples=300"``), a
                `NativePolicy`, a function of the infos that returns actions ``(N, *A)``, or an object with such a
                function as ``get_action(infos)``. Its ``set_env(envs)`` is called, if it has one. Environments of
                gymnasium take ``"random"``, functions and objects.
            seed: For policies of the core: seed of their own noise.
        """
        if isinstance(policy, str):
            policy = NativePolicy(policy, seed=seed)
        if isinstance(policy, NativePolicy) and self._core is None:
            if policy.text != "random":
                raise TypeError(
                    f"the policy `{policy.text}` acts on environments of this package, not on those of gymnasium; give "
                    "'random', a function of the infos, or an object with get_action(infos)"
                )
            from ..policy import RandomPolicy

            policy = RandomPolicy(policy.seed)
        if isinstance(policy, NativePolicy):
            self._attach(policy)
            self.policy = policy
            return
        self.policy = policy = as_policy(policy)
        if hasattr(policy, "set_env"):
            policy.set_env(self.envs)
        if hasattr(policy, "_set_seed") and getattr(policy, "seed", None) is not None:
            policy._set_seed(policy.seed)
        if self._core is not None:
            self._attach(policy)

    def set_success(self, rule: Mapping[str, Any] | None) -> None:
        """Judge success by a rule in place of the environment's own; None gives that back.

        Args:
            rule: ``{"hold": 1, "all": [{"column": "block_pose", "goal": "goal_pose", "elements": [0, 1], "measure":
                "distance", "below": 20.0}, …]}``: the conditions that must hold at once, in ``hold`` steps on end.
        """
        self._native()
        self.envs.set_success(json.dumps(rule or {}, default=_plain))

    def reset(self, seed: Any = None, options: Any = None) -> None:
        """Begin an episode in every environment.

        Args:
            seed: Seed of a run: environment ``i`` begins its episode ``i``. A list names the episodes' own seeds. None:
                the next episodes.
            options: A dict or a list of N: ``variation`` (names of factors, groups or ``"all"``, to be sampled),
                ``variation_values``, ``state``, ``goal_state``, ``start``, ``goal``, ``goal_image``.
        """
        _, self.infos = self.envs.reset(seed=seed, options=options)
        self._stale = False
        self._rewards = None if self._rewards is None else np.zeros(self.num_envs, dtype=np.float32)
        self._terminateds = np.zeros(self.num_envs, dtype=bool)
        self._truncateds = np.zeros(self.num_envs, dtype=bool)
        self._show()

    @explains_actions
    def step(self, actions: npt.ArrayLike | None = None) -> None:
        """Step every environment whose episode is not over; infos and results are updated.

        The others keep their last infos, with reward 0 and no end, until they are reset.

        Args:
            actions: ``(N, *A)`` of any real type; None: those of the policy.

        Raises:
            SwmError: No episode has begun, or all are over: call `reset`.
        """
        if actions is None and not isinstance(self.policy, NativePolicy):
            actions = self._get_actions()
        elif actions is not None and self.envs.action_space.shape is not None:
            space = self.envs.action_space
            actions = as_actions("World.step was given", actions, tuple(space.shape), must="give") if _is_odd(actions) else actions
        if self._core is None:
            _, self.rewards, self.terminateds, self.truncateds, self.infos = self.envs.step(actions)
            return
        self._core.step(actions)
        self._stale = True
        if self._transforms:
            self._show()

    def _get_actions(self) -> npt.NDArray[Any]:
        if self.policy is None:
            raise RuntimeError("No policy set. Call world.set_policy(...) first, or give actions to step.")
        return ask(self.policy, self.infos, self.envs.action_space)

    def _run(
        self,
        episodes: int | None = None,
        max_steps: int | None = None,
        seed: int | None = None,
        options: Any = None,
        mode: str = "auto",
        on_step: Any = None,
        on_done: Any = None,
    ) -> None:
        """Step the policy through the environments from Python; ``on_done(row, episode, world)`` as each ends."""
        for row, episode in self._run_iter(episodes, max_steps, seed, options, mode, on_step):
            if on_done:
                on_done(row, episode, self)

    def _run_iter(
        self,
        episodes: int | None = None,
        max_steps: int | None = None,
        seed: int | None = None,
        options: Any = None,
        mode: str = "auto",
        on_step: Any = None,
    ) -> Iterator[tuple[int, int]]:
        return foreign.run_iter(self, episodes, max_steps, seed, options, mode, on_step)

    def _show(self) -> None:
        """Replace images of the infos by transformed ones."""
        for name, transform in self._transforms.items():
            if name in self.infos:
                # Transforms may write into the images that they are given.
                self.infos[name] = _stacked([transform(image) for image in self.envs.raw(name)[:, 0].copy()])

    def __getstate__(self) -> dict[str, Any]:
        """All but what the pool holds: the core and, of environments of this package, the infos."""
        state = dict(self._fresh().__dict__)
        if self._core is not None:
            del state["_core"], state["infos"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if not isinstance(self.envs, NativePool):
            return
        self._core, self.infos = self.envs.core, self.envs.infos
        if self.policy is not None:
            self._attach(self.policy)
        self._show()

    def _attach(self, policy: Any) -> None:
        """Give the core its policy, or a stand-in for one in Python."""
        assert self._core is not None
        if isinstance(policy, NativePolicy):
            self._core.set_policy(policy.text)
            log_notes(self._core.notes_on(policy.text))
            self._core.set_policy_seed(policy.seed)
        else:
            self._core.set_policy(None, foreign=describe(policy))
        self.envs.renew()

    def _native(self) -> _swm.World:
        if self._core is None:
            raise TypeError("this World holds environments of gymnasium; only those of this package can do that")
        return self._core

    def show(
        self,
        *paths: str | PathLike[str],
        save: str | PathLike[str] | None = None,
        notebook: str | None = None,
        open_browser: bool | None = None,
    ) -> Page:
        """Open the page in the browser on this kind of environment; see :class:`stable_worldmodel_rs.ui.Page`.

        The page steers an environment of its own: this World does not change.
        """
        from ..ui import Page

        env: str | None = self._built.get("id")
        if env is None:
            raise TypeError("this World holds environments of gymnasium; the page shows those of this package only")
        return Page(*paths, env=explicit(env), save=save, notebook=notebook, open_browser=open_browser)

    def close(self) -> None:
        """Free the environments. Arrays that were taken from the infos stay readable."""
        self.envs.close()

    def __enter__(self) -> World:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _rows(self) -> list[tuple[str, str]]:
        name = self._built.get("id") or foreign.name_of(self.envs.envs[0])
        rows = [("environment", str(name)), ("environments", str(self.num_envs))]
        if image := self._built.get("image"):
            rows.append(("images", f"{image[0]}×{image[1]}"))
        if limit := self._built.get("max_episode_steps"):
            rows.append(("steps per episode", str(limit)))
        if self.policy is not None:
            rows.append(("policy", self.policy.text if isinstance(self.policy, NativePolicy) else describe(self.policy)))
        return rows

    def __repr__(self) -> str:
        return "World(" + ", ".join(f"{name}: {value}" for name, value in self._rows()) + ")"

    def _repr_html_(self) -> str:
        if self._core is None or "pixels" not in self.infos:
            return html_table(self._rows())
        frames = self.envs.raw("pixels")[:_SHOWN, 0]
        return html_table(self._rows()) + html_image(_swm.contact_sheet(np.ascontiguousarray(frames)), "now")


def _require_functions(given: list[Any]) -> None:
    """Refuses a list in which something makes no environment, such as one of ids or of environments."""
    wrong = [one for one in given if not callable(one)]
    if wrong and isinstance(wrong[0], str):
        raise TypeError(f"World was given a list with {wrong[0]!r}; give the id alone, and how many: World({wrong[0]!r}, num_envs={len(given)})")
    if wrong:
        kind = kind_of(wrong[0])
        raise TypeError(f"World was given a list with an object of {kind}; give functions that each make an environment: [{kind}] * {len(given)}, or [lambda: {kind}(…)]")


def _require_shape(image_shape: tuple[int, int] | None, add_pixels: bool) -> None:
    """Refuses images without a size, once the environments exist: a wrong name of them or of an argument is said first."""
    if add_pixels and image_shape is None:
        raise ValueError("image_shape is required when add_pixels=True; give (height, width) or add_pixels=False.")


def _plain(value: Any) -> Any:
    """Values of NumPy as JSON has them."""
    if isinstance(value, (np.ndarray, np.generic)):
        return cast("Any", value).tolist()
    raise TypeError(f"the setting {value!r} is no number, text or list")


def _is_odd(actions: Any) -> bool:
    """Whether actions are no array, so that they are looked at before the core gets them."""
    return not isinstance(actions, np.ndarray)


def _stacked(images: list[Any]) -> Any:
    """Transformed images ``(…)`` of N environments as ``(N, 1, …)``: arrays or tensors."""
    if hasattr(images[0], "unsqueeze"):
        import torch

        return torch.stack(images).unsqueeze(1)
    return np.stack(images)[:, None]

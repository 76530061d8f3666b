"""The pool of environments behind a `World` of this package: one Rust World, stepped as a whole."""

from __future__ import annotations

import difflib
import inspect
import json
import logging
import secrets
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector.utils import batch_space

from .. import spaces
from .._arguments import kind_of, whole_number
from .._arrays import image_sides
from .._core import core as _swm
from .rows import reset_options

Options = Mapping[str, Any]
Infos = dict[str, Any]
logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")

# Seeds of runs that nobody chose are sampled below this.
_SEEDS = 2**32


def make_native(of: Callable[..., Any], **given: Any) -> _swm.World:
    """The environments of a World, or behind an `Env`.

    A setting that the environment does not know and that is near an argument of ``of`` is one that the user meant.
    """
    try:
        return _swm.World(**given)
    except _swm.EnvError as error:
        names: list[str] = list(json.loads(given["settings"]))
        for name in names:
            near = nearest_argument(of, name)
            # Where the argument is a setting, too, the core has named it.
            if near and f"`{name}`" in str(error) and f"did you mean `{near}`?" not in str(error):
                raise _swm.EnvError(f"{error}; did you mean {near}=?") from None
        raise


def nearest_argument(of: Callable[..., Any], name: str) -> str | None:
    """The argument of a function that a name may mean which it does not have; None where none is near."""
    return next(iter(difflib.get_close_matches(name, inspect.signature(of).parameters, 1, 0.65)), None)


def whole(what: str, value: Any, most: int = 2**64 - 1, least: int = 0) -> int:
    """A whole number, such as a seed.

    Raises:
        TypeError: It is something else.
        SwmError: It is less than ``least``, or more than ``most``.
    """
    try:
        return whole_number(what, value, least, most)
    except ValueError as error:
        raise _swm.SwmError(str(error)) from None


def checked_shape(image_shape: Any) -> tuple[int, int] | None:
    """The height and width of images as integers; None for no images.

    Raises:
        TypeError: It is no pair of integers.
    """
    return None if image_shape is None else image_sides("image_shape", image_shape)


class NativePool:
    """Environments of this package, stepped together: what ``world.envs`` is.

    ``reset`` and ``step`` return the infos, one dict whose arrays ``(N, 1, …)`` stay the same objects: every reset and
    step writes into them. They are read-only; copy what you keep or change.

    Episodes are numbered: ``reset(seed=s)`` begins episode ``i`` of run ``s`` in environment ``i``, and later resets
    without a seed begin the next episodes of that run. A list of seeds names the episodes' own seeds, as they stand in
    the column ``seed``.

    ``copy.deepcopy`` and ``pickle`` make a pool whose episodes go on alike from the same step.
    """

    def __init__(self, core: _swm.World, built: Mapping[str, Any], hidden: Sequence[str] = ()) -> None:
        self.core = core
        self._built = dict(built)
        self._hidden = frozenset(hidden)
        self._distractors: list[str] = []
        self._success = "{}"
        self.spec_data: dict[str, Any] = json.loads(core.spec_json())
        self.infos: Infos = {}
        self._arrays: Infos = core.infos()
        results = core.results()
        self._results = (results["rewards"], results["terminateds"], results["truncateds"])
        self._varied: list[frozenset[str]] = [frozenset()] * core.num_envs
        self._run: int | None = None
        self._next = 0
        self._handles: list[EnvHandle] | None = None
        self._show()

    @property
    def num_envs(self) -> int:
        """Number of environments."""
        return self.core.num_envs

    @property
    def seeds(self) -> npt.NDArray[np.int64]:
        """The seed of each environment's episode, ``(N,)``: the column ``seed``."""
        return self._arrays["seed"].reshape(-1).copy()

    @property
    def results(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Rewards, terminations and truncations of the last step, ``(N,)`` each, written by every step."""
        return self._results

    def reset(
        self,
        seed: int | Sequence[int | None] | npt.NDArray[np.integer[Any]] | None = None,
        options: Options | Sequence[Options | None] | None = None,
        mask: Sequence[bool] | npt.NDArray[np.bool_] | None = None,
    ) -> tuple[None, Infos]:
        """Begin an episode in every environment, or in those that ``mask`` ``(N,)`` chooses.

        Args:
            seed: The seed of a run, a list of N seeds of episodes, or None for the next episodes of the run.
            options: A dict for all, or a list of N: ``variation``, ``variation_values``, ``state``, ``goal_state``,
                ``start``, ``goal``, ``goal_image`` (``(H, W, 3)``, in place of the rendered one).
            mask: Which environments to reset.
        """
        count = self.num_envs
        chosen = [row for row in range(count) if mask is None or mask[row]]
        seeds: list[int | None] = [None] * count
        listed = cast("Sequence[Any]", seed) if isinstance(seed, (Sequence, np.ndarray)) and not isinstance(seed, str) else None
        if listed is None:
            run = self.run_seed(cast("int | None", seed), goes_on=seed is None)
        else:
            run = self.run_seed(None, goes_on=True)
            seeds = [None if one is None else whole("seed", one, 2**63 - 1) for one in listed]
            if len(seeds) != count:
                raise _swm.SwmError(f"seed: {len(seeds)} seeds for {count} environments; give one per environment")
        each = _each(options, count)
        # A whole reset with a seed gives environment i episode i; others take what comes next.
        resets = [(row, run, self._next + place, seeds[row], each[row]) for place, row in enumerate(chosen)]
        self.core.reset(resets)
        self._next += len(chosen)
        for row in chosen:
            self._varied[row] = self._sampled(each[row])
        self._show()
        return None, self.infos

    def step(
        self, actions: npt.ArrayLike, mask: Sequence[bool] | npt.NDArray[np.bool_] | None = None
    ) -> tuple[None, npt.NDArray[np.float32], npt.NDArray[np.bool_], npt.NDArray[np.bool_], Infos]:
        """Step every environment whose episode is not over, or those of them that ``mask`` chooses.

        Args:
            actions: ``(N, *A)`` of any real type. Rows of environments that do not step may be NaN.
            mask: ``(N,)``; environments that it leaves out keep their infos, and have reward 0.

        Returns:
            None, rewards f32 ``(N,)``, terminations and truncations bool ``(N,)``, and the infos.
        """
        self.core.step(actions, None if mask is None else [bool(flag) for flag in mask])
        rewards, terminateds, truncateds = self._results
        return None, rewards.copy(), terminateds.copy(), truncateds.copy(), self.infos

    def run_seed(self, seed: int | None, goes_on: bool = False) -> int:
        """The seed of a run: the one given, or a sampled one; with ``goes_on``, that of the last run, if any."""
        if seed is None:
            if not goes_on or self._run is None:
                self._run, self._next = secrets.randbelow(_SEEDS), 0
        else:
            self._run, self._next = whole("seed", seed), 0
        assert self._run is not None
        return self._run

    def set_distractors(self, distractors: Sequence[str]) -> None:
        """Show images through distractors."""
        self.core.set_distractors(list(distractors))
        self._distractors = list(distractors)

    def set_success(self, rule: str) -> None:
        """Judge success by a rule, as JSON; ``{}`` is the environment's own."""
        self.core.set_success(rule)
        self._success = rule

    def __getstate__(self) -> dict[str, Any]:
        """How it was made, and every environment amid its episode."""
        kept = ("_built", "_hidden", "_distractors", "_success", "_varied", "_run", "_next")
        return {"saved": self.core.save(), **{name: getattr(self, name) for name in kept}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        state = dict(state)
        saved = state.pop("saved")
        built = state["_built"]
        self.__init__(_swm.World(**built), built)  # type: ignore[misc]
        self.__dict__.update(state)
        self.set_distractors(self._distractors)
        self.set_success(self._success)
        self.core.restore(saved)
        self._show()

    def prepare(self, options: Options | Sequence[Options | None] | None) -> None:
        """Make the infos ready for a run with these options."""
        if options is None or isinstance(options, Mapping):
            varied = self._sampled(options)
        else:
            varied = frozenset[str]().union(*(self._sampled(one) for one in options))
        self._varied = [varied] * self.num_envs
        self._show()

    def raw(self, name: str) -> npt.NDArray[Any]:
        """A column as the core writes it, read-only, whatever stands in the infos."""
        return self._arrays[name]

    @property
    def envs(self) -> list[EnvHandle]:
        """One handle per environment."""
        if self._handles is None:
            self._handles = [EnvHandle(self, row) for row in range(self.num_envs)]
        return self._handles

    @cached_property
    def single_action_space(self) -> gym.Space[Any]:
        """The space of one environment's action."""
        return spaces.action_space(self.spec_data)

    @cached_property
    def action_space(self) -> gym.Space[Any]:
        """The space of all environments' actions, ``(N, …)``."""
        return batch_space(self.single_action_space, self.num_envs)

    @cached_property
    def single_observation_space(self) -> gym.Space[Any]:
        """The space of one environment's observation."""
        return spaces.observation_space(self.spec_data)

    @cached_property
    def observation_space(self) -> gym.Space[Any]:
        """The space of all environments' observations."""
        return batch_space(self.single_observation_space, self.num_envs)

    @property
    def variation_space(self) -> spaces.Dict:
        """The factors of variation; see `EnvHandle.variation_space`."""
        return self.envs[0].variation_space

    @property
    def single_variation_space(self) -> spaces.Dict:
        """As ``variation_space``."""
        return self.variation_space

    def close(self) -> None:
        """Free the environments. Infos that were taken stay readable."""
        self.core.close()

    def renew(self) -> None:
        """Take the arrays of the infos anew, where another policy brought other columns."""
        self._arrays = self.core.infos()
        self._show()

    def _show(self) -> None:
        """Fill ``infos``: all columns, but of the factors of variation only those that were sampled or set."""
        varied = frozenset[str]().union(*self._varied)
        shown: Infos = {
            name: array
            for name, array in self._arrays.items()
            if name not in self._hidden and (not name.startswith("variation.") or name[10:] in varied)
        }
        shown["id"] = self._arrays["seed"]
        shown["env_name"] = [[self.core.id] for _ in range(self.num_envs)]
        for name in [name for name in self.infos if name not in shown]:
            del self.infos[name]
        self.infos.update(shown)

    def _sampled(self, options: Options | None) -> frozenset[str]:
        """The factors that a reset with these options samples or sets."""
        given = options or {}
        return frozenset(self.core.sampled_factors(variation_names(given))) | set(given.get("variation_values") or ())


class EnvHandle:
    """One environment of a pool: what ``world.envs.envs[i]`` is."""

    def __init__(self, pool: NativePool, row: int) -> None:
        self._pool = pool
        self._row = row
        self._variation: spaces.Dict | None = None

    @property
    def unwrapped(self) -> EnvHandle:
        """Itself: there are no wrappers."""
        return self

    @property
    def action_space(self) -> gym.Space[Any]:
        """The space of its action."""
        return self._pool.single_action_space

    @property
    def observation_space(self) -> gym.Space[Any]:
        """The space of its observation."""
        return self._pool.single_observation_space

    @property
    def variation_space(self) -> spaces.Dict:
        """Its factors of variation as a nested space; ``["agent"]["color"].value`` is that of its episode."""
        if self._variation is None:
            self._variation = spaces.variation_space(self._pool.spec_data)
        if self._pool._run is not None:  # pyright: ignore[reportPrivateUsage]
            spaces.show_values(self._variation, self._pool._arrays, self._row)  # pyright: ignore[reportPrivateUsage]
        return self._variation

    def reset_options_from_dataset(self, init_row: Mapping[str, Any], goal_row: Mapping[str, Any]) -> dict[str, Any]:
        """Options of a reset that stands at one recorded row and aims at another (its columns as ``goal_<column>``)."""
        return reset_options(self._pool.spec_data, init_row, goal_row)


def plain_options(options: Options | None) -> dict[str, Any] | None:
    """Reset options as dicts, whatever mappings they were given as (those of Hydra, say).

    Raises:
        TypeError: They are no mapping, or ``variation`` is no list of names.
    """
    if options is None:
        return None
    if not isinstance(cast("Any", options), Mapping):
        raise TypeError(f"options: {kind_of(options)} in the place of a dict; give a dict for all, or a list of dicts, one per environment")
    names = variation_names(options)
    return {
        name: names if name == "variation" else dict(cast("Mapping[str, Any]", value)) if isinstance(value, Mapping) else value
        for name, value in options.items()
    }


def variation_names(options: Options) -> list[str] | None:
    """The names of factors in ``variation`` of reset options, one or several; None where it is not given.

    Raises:
        TypeError: One is no text.
    """
    given: Any = options.get("variation")
    if given is None or isinstance(given, str):
        return None if given is None else [given]
    names: list[Any] = list(given) if hasattr(given, "__iter__") else [given]
    if wrong := [name for name in names if not isinstance(name, str)]:
        raise TypeError(f"variation={given!r}: {wrong[0]!r} is no name; give names of factors, such as variation=['agent.color'], or 'all'")
    return names


def note_unsampled(factors: Sequence[str]) -> None:
    """Tell which factors keep their defaults in every episode, since ``variation`` does not name them."""
    if factors:
        logger.warning(
            'variation samples only what it names; %s keep their defaults in every episode ("default" samples them, too)',
            ", ".join(factors),
        )


def _each(options: Options | Sequence[Options | None] | None, count: int) -> list[dict[str, Any] | None]:
    """Options of every environment."""
    if options is None or isinstance(options, Mapping):
        return [plain_options(options)] * count
    each = [plain_options(one) for one in options]
    if len(each) != count:
        raise _swm.SwmError(f"options: {len(each)} dicts for {count} environments; give one per environment")
    return each

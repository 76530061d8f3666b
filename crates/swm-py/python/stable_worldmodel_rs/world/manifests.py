"""Tasks that others can repeat: manifests. What is evaluated on them is in `receipts` and `sweeps`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from .._access import access_checked
from .._arguments import names_of, path_of, request_text
from .._core import core as _swm
from .._requests import log_notes
from .ids import native_env
from .native import checked_shape

AnyPath = str | PathLike[str]


class Manifest(dict[str, Any]):
    """A fixed list of starts and goals with a budget and a rule of success: what is evaluated. ``hash`` names it."""

    def __init__(self, data: Mapping[str, Any], hash: str) -> None:
        super().__init__(data)
        self.hash = hash

    def __repr__(self) -> str:
        return f"Manifest({self['env']}, {self['tier']} tier, {len(self['pairs'])} pairs, {self.hash[:12]})"


def existing(path: AnyPath, what: str) -> str:
    """The path of a file that has to be there; ``what`` it is, for the message."""
    found = Path(path_of(f"the {what}", path, "its path")).expanduser()
    if not found.exists():
        raise FileNotFoundError(f"there is no {what} {found}")
    return str(found)


@access_checked
def read_manifest(path: AnyPath) -> Manifest:
    """Read a manifest (TOML or JSON). One that was changed after it was written is refused.

    Raises:
        FileNotFoundError: There is no such file.
        SwmError: It is no manifest, or was changed.
    """
    text, hash = _swm.manifest_json(existing(path, "manifest"))
    return Manifest(json.loads(text), hash)


def _chosen(pairs: Sequence[str | tuple[int, int, int]]) -> list[str]:
    """Chosen pairs as text: ``EPISODE:START-GOAL``."""
    if isinstance(pairs, str):
        raise TypeError(f"pairs={pairs!r} is a text; give a list: [{pairs!r}]")
    return [pair if isinstance(pair, str) else _pair(pair) for pair in pairs]


def _pair(pair: tuple[int, int, int]) -> str:
    if len(pair) != 3:
        raise ValueError(f"a pair is (episode, start, goal) or a text such as '3:10-35', found {pair!r}")
    episode, start, goal = map(int, pair)
    return f"{episode}:{start}-{goal}"


# The arguments of settings that have another name in the core.
_ARGUMENTS = {"env_option": "settings", "distractor": "distractors", "vary": "variation", "set": "variation_values"}


@access_checked
def make_manifest(
    path: AnyPath,
    env_name: str,
    episodes: int = 100,
    *,
    tier: str = "historic",
    seed: int = 42,
    budget: int | None = None,
    dataset: AnyPath | None = None,
    opening: Mapping[str, Any] | None = None,
    goal_offset: int = 25,
    held_out: float = 0.2,
    pairs: Sequence[str | tuple[int, int, int]] | None = None,
    clear: AnyPath | None = None,
    frame_skip: int | None = None,
    image_shape: tuple[int, int] | None = None,
    distractors: Sequence[str] | str = (),
    variation: Sequence[str] | str | None = None,
    variation_values: Mapping[str, Any] | None = None,
    overwrite: bool = False,
    **settings: Any,
) -> Manifest:
    """Choose starts and goals, and write them into a file.

    A file that holds another manifest is not replaced, as results refer to it.

    Args:
        path: ``….toml`` or ``….json``.
        env_name: An environment of this package.
        episodes: Pairs of start and goal.
        tier: ``"historic"`` (as published), ``"moderate"`` (held-out episodes, no success at reset, starts at rest) or
            ``"strict"`` (more motion, a tighter rule).
        seed: Of the choice.
        budget: Actions allowed; None: 200, or 50 from a dataset.
        dataset: Take starts and goals from its rows, the goal ``goal_offset`` rows after the start.
        opening: How a dataset of another program is opened: ``camera``, ``map`` and so on, as ``options`` of ``NativeDataset``.
        held_out: Share of its episodes that is held out from training.
        pairs: These steps of ``dataset`` as starts and goals, in place of ``episodes``, ``goal_offset`` and ``held_out``:
            (episode, start, goal), counted from 0, or ``"3:10-35"``, or ``"3:10-4:0"`` for a goal in another episode.
        clear: A manifest of the benchmark CLEAR-LeWM: its pairs of ``dataset``, test of success, budget and seed, in place of those
            arguments.
        frame_skip: How often each action is applied; None: 1, or as recorded.
        image_shape: (height, width) of the images that policies see.
        distractors: What changes those images.
        variation: Factors to sample; ``"+NAME"`` in addition to the default ones. ``variation_values``: factors to set, by
            numbers, or by the names of colors and choices.
        overwrite: Replace a file that holds something else.
        **settings: Of the environment.

    Raises:
        FileNotFoundError: There is no such dataset.
        SwmError: The file exists and is not this manifest; or the environment, a factor or the dataset does not fit.
    """
    from ..data._paths import recorded
    from ..data.native import as_options

    shape = checked_shape(image_shape)
    if "image_size" in settings:
        raise TypeError("make_manifest has no argument 'image_size'; did you mean image_shape=(64, 64)?")
    native, options = native_env(env_name, settings)
    request = {
        "env": native or env_name,
        "env_option": options,
        "tier": tier,
        "out": str(path),
        "episodes": episodes,
        "seed": seed,
        "dataset": None if dataset is None else recorded("dataset", dataset),
        "opening": as_options(opening or {}),
        "pairs": None if pairs is None else _chosen(pairs),
        "clear": None if clear is None else existing(clear, "manifest"),
        "goal_offset": goal_offset,
        "held_out": held_out,
        "budget": budget,
        "frame_skip": frame_skip,
        "image_size": None if shape is None else {"height": shape[0], "width": shape[1]},
        "distractor": names_of(distractors),
        "vary": names_of(variation),
        "set": dict(variation_values or {}),
        "overwrite": overwrite,
    }
    text, hash, notes = _swm.make_manifest(request_text(request, _ARGUMENTS))
    log_notes(notes)
    return Manifest(json.loads(text), hash)


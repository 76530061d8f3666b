"""Starts and goals out of a dataset, for evaluations on recorded rows."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from .._core import core as _swm

Row = dict[str, Any]

# Methods of the reference's environments that set what a reset of ours takes from the same rows anyway.
SETTERS = frozenset(
    {
        "_set_state",
        "set_state",
        "_set_goal_state",
        "set_goal_state",
        "_set_goal",
        "set_goal",
        "set_target_pos",
        "set_target_qpos",
    }
)


def extract_init_goal(
    dataset: Any, episodes_idx: Sequence[int], start_steps: Sequence[int], goal_offset: int
) -> tuple[list[Row], list[Row], list[npt.NDArray[Any]]]:
    """The rows that an evaluation starts at, those it aims at, and the recorded images between the two.

    Args:
        dataset: Anything with ``load_chunk(episodes, starts, ends)`` and ``column_names``.
        episodes_idx: Episode of each pair.
        start_steps: Step of the start in it.
        goal_offset: The goal is so many steps later.

    Returns:
        For each pair, the columns of its first row (with the constants of the episode), those of its last row as
        ``goal`` (the image) and ``goal_<column>``, and its images ``(T, H, W, C)``.
    """
    episodes, starts = np.asarray(episodes_idx), np.asarray(start_steps)
    chunks = dataset.load_chunk(episodes, starts, starts + goal_offset + 1)
    constants = list(getattr(dataset, "episode_column_names", None) or [])
    of_episodes: Mapping[str, Sequence[Any]] = dataset.get_episode_data(episodes_idx) if constants else {}
    firsts: list[Row] = []
    lasts: list[Row] = []
    videos: list[npt.NDArray[Any]] = []
    for pair, chunk in enumerate(chunks):
        first: Row = {}
        last: Row = {}
        for column in dataset.column_names:
            values = _as_numpy(chunk.get(column))
            if values is None or column.startswith("goal"):
                continue
            if column.startswith("pixels"):
                # Datasets give images as torch has them: channels first.
                values = np.moveaxis(values, 1, -1)
            first[column] = values[0]
            last["goal" if column == "pixels" else f"goal_{column}"] = values[-1]
            if column == "pixels":
                videos.append(values)
        for column in constants:
            first[column] = of_episodes[column][pair]
        firsts.append(first)
        lasts.append(last)
    return firsts, lasts, videos


def reset_options(spec: Mapping[str, Any], first: Mapping[str, Any], last: Mapping[str, Any]) -> dict[str, Any]:
    """Options of a reset that stands at the row ``first`` with the goal of the row ``last``, under the recorded factors.

    Raises:
        SwmError: The rows lack every column that a start or a goal is set from.
    """
    start = {column: first[column] for column in spec["start_columns"] if column in first}
    goal = {column: last[f"goal_{column}"] for column in spec["goal_columns"] if f"goal_{column}" in last}
    for what, found, wanted in (("start", start, spec["start_columns"]), ("goal", goal, spec["goal_columns"])):
        if wanted and not found:
            raise _swm.SwmError(
                f"`{spec['id']}`: the dataset has no column for the {what}; it needs one of {', '.join(wanted)}"
            )
    start.update({column: first[column] for column in spec["start_extras"] if column in first})
    goal.update({column: last[f"goal_{column}"] for column in spec["goal_extras"] if f"goal_{column}" in last})
    known = [factor["name"] for factor in spec["factors"]]
    values = {name: first[f"variation.{name}"] for name in known if f"variation.{name}" in first}
    return {"variation": [], "variation_values": values, "start": start, "goal": goal}


def goal_images(
    dataset: Any, spec: Mapping[str, Any], built: Mapping[str, Any], last: Mapping[str, Any], renderer: str | None
) -> str | None:
    """Why the recorded frames of goals are not what this World would show, and goals are rendered anew; None: they are.

    As `GoalImages` of the core decides; an empty text where there is nothing to say, as the World has no images of goals.
    """
    shape = next((tuple(field["shape"]) for field in spec["fields"] if field["name"] == "goal"), None)
    if shape is None:
        return ""
    frame: Any = last.get("goal")
    if frame is None:
        return "the dataset has no images"
    if frame.dtype != np.uint8 or frame.ndim != 3:
        return "the dataset's images are no frames (H, W, 3) of bytes"
    if frame.shape != shape:
        found, own = ("x".join(map(str, size[:2])) for size in (frame.shape, shape))
        return f"the dataset's images are {found}, this World's are {own}"
    metadata: Any = getattr(dataset, "metadata", None)
    if not isinstance(metadata, Mapping) or "env" not in metadata:
        return "the dataset does not state the settings that it was recorded with"
    recorded = cast("Mapping[str, Any]", metadata)
    if recorded.get("settings", {}) != json.loads(built["settings"]):
        return "the dataset was recorded with other settings of the environment"
    if recorded.get("renderer") != renderer:
        return "the dataset was recorded with another renderer"
    return None


def check_callables(callables: Sequence[Mapping[str, Any]] | None) -> None:
    """Accept the setters that a reset implies, and refuse others.

    Raises:
        ValueError: A method that only the reference's environments have.
    """
    for spec in callables or ():
        if spec["method"] not in SETTERS:
            raise ValueError(
                f"callables: `{spec['method']}` cannot be called on the environments of this package, which set start and "
                "goal from the dataset's rows themselves; use options=, or an environment from gymnasium.make"
            )


def check_recording(dataset: Any, env: str, frame_skip: int) -> None:
    """Refuse a dataset that says it was recorded in another environment, or with rows another time apart."""
    found: Any = getattr(dataset, "metadata", None)
    if not isinstance(found, Mapping):
        return
    metadata = cast("Mapping[str, Any]", found)
    recorded, skip = metadata.get("env", env), metadata.get("frame_skip", frame_skip)
    # What other programs recorded, and its copies, may fit.
    if recorded in ("", "unknown"):
        return
    if recorded != env:
        raise _swm.SwmError(f"the dataset was recorded in `{recorded}`, this World is `{env}`")
    if skip != frame_skip:
        raise _swm.SwmError(
            f"the dataset was recorded with frame skip {skip}, this World has {frame_skip}: its rows are another time "
            f"apart; make the World with frame_skip={skip}"
        )


def apply_callables(env: Any, callables: Sequence[Mapping[str, Any]], row: Mapping[str, Any]) -> None:
    """Call methods of an environment with values of a row; methods that it lacks are left out."""
    for spec in callables:
        method = getattr(env, spec["method"], None)
        if method is None:
            continue
        arguments: Row = {}
        for name, source in spec.get("args", {}).items():
            if not source.get("in_dataset", True):
                arguments[name] = source.get("value")
            elif source.get("value") in row:
                arguments[name] = deepcopy(row[source["value"]])
        method(**arguments)


def _as_numpy(values: Any) -> npt.NDArray[Any] | None:
    """An array or a tensor as an array; None for others."""
    if isinstance(values, np.ndarray):
        return cast("npt.NDArray[Any]", values)
    if hasattr(values, "detach") and hasattr(values, "cpu"):
        return values.detach().cpu().numpy()
    return None

"""Evaluation from a dataset in one call: rows are chosen, a World is stepped from them, successes are counted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .._access import access_checked
from .policies import explains_actions
from .native import whole
from .results import EvaluationResult
from .world import World


@explains_actions
@access_checked
def evaluate_from_dataset(
    world: World,
    dataset: Any,
    episodes_idx: Sequence[int] | None = None,
    start_steps: Sequence[int] | None = None,
    goal_offset_steps: int | None = None,
    eval_budget: int = 50,
    callables: Sequence[Mapping[str, Any]] | None = None,
    save_video: bool = False,
    video_path: str | Path = "./",
    *,
    episodes: int = 50,
    goal_offset: int = 25,
    seed: int = 42,
    progress: bool = False,
    opening: Mapping[str, Any] | None = None,
) -> EvaluationResult:
    """Start at recorded rows, aim at the rows ``goal_offset`` later.

    Args:
        world: Environments with a policy.
        dataset: A path, or anything with ``lengths``, ``load_chunk`` and ``column_names``; see ``swm.data.load_dataset``.
        episodes_idx: Episode of each pair; None: rows are sampled uniformly, as by ``swm-rs eval --dataset``.
        start_steps: Step of each start.
        goal_offset_steps: As ``goal_offset``, by the name of older versions of the reference.
        eval_budget: Actions allowed.
        callables: Implied for environments of this package.
        save_video: Whether to write videos into ``video_path``.
        episodes: Pairs to sample.
        seed: Of the choice of rows and of the run.
        progress: Whether to show a bar.
        opening: With a path: how a dataset of another program is opened, as ``options`` of ``NativeDataset``.
    """
    from .._core import core as _swm
    from ..data import load_dataset

    if isinstance(dataset, (str, Path)):
        dataset = load_dataset(dataset, **dict(opening or {}))
    elif opening:
        raise TypeError("opening is about a path, and an open dataset was given; open it with these options")
    offset = goal_offset if goal_offset_steps is None else goal_offset_steps
    if (episodes_idx is None) != (start_steps is None):
        raise ValueError("give episodes_idx and start_steps together, or neither")
    if episodes_idx is None or start_steps is None:
        starts = _swm.choose_starts([int(length) for length in dataset.lengths], whole("episodes", episodes, least=1), whole("goal_offset", offset), whole("seed", seed))
        episodes_idx, start_steps = [episode for episode, _ in starts], [step for _, step in starts]
    return world.evaluate(
        dataset=dataset,
        episodes_idx=list(episodes_idx),
        start_steps=list(start_steps),
        goal_offset=offset,
        eval_budget=eval_budget,
        callables=callables,
        video=video_path if save_video else None,
        seed=seed,
        progress=progress,
    )

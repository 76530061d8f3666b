"""Runs of environments that are Python objects: the loops behind `World` where the core has no part."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from .._progress import Progress
from .ids import recorded_id
from .native import NativePool
from .policies import NativePolicy, describe
from .recording import EpisodeRecorder
from .results import EvaluationResult
from .rows import apply_callables, extract_init_goal

if TYPE_CHECKING:
    from .world import World

Mask = npt.NDArray[np.bool_]


class OnStep(Protocol):
    """Called after every reset and step, with the environments that took part, ``(N,)``."""

    def __call__(self, world: World, *, mask: Mask) -> None: ...


# Where datasets take values that belong to an episode, not to a step.
EPISODE_DATA_KEY = "_episode_data"
_FRAMES_PER_SECOND = 30
# Of the record that a dataset has of its recording.
_METADATA_VERSION = 1


def run_iter(
    world: World,
    episodes: int | None,
    max_steps: int | None,
    seed: int | None,
    options: Any,
    mode: str,
    on_step: OnStep | None,
) -> Iterator[tuple[int, int]]:
    """Step the policy through the environments; gives (environment, number of the episode) as each ends.

    Episodes are numbered as they begin, and those below ``episodes`` are run to their ends: the first to end would be the short ones, whichever
    environments run them. ``auto``: whoever is done begins another episode; ``wait``: whoever is done waits for the others.
    """
    assert mode in ("auto", "wait"), f"reset_mode must be 'auto' or 'wait', found {mode!r}"
    if world.policy is None:
        raise RuntimeError("No policy set.")
    if episodes is None and max_steps is None:
        raise ValueError("Provide episodes or max_steps (or both).")
    count = world.num_envs
    if seed is not None or options is not None:
        world.reset(seed=seed, options=options)
        if on_step:
            on_step(world, mask=np.ones(count, dtype=bool))
    numbers = np.arange(count)
    begun = count
    alive = np.ones(count, dtype=bool) if episodes is None else numbers < episodes
    steps = 0
    while alive.any() and (max_steps is None or steps < max_steps):
        steps += 1
        if isinstance(world.policy, NativePolicy):
            world.step()
        else:
            actions = world._get_actions()  # pyright: ignore[reportPrivateUsage]
            world.infos.pop("_needs_flush", None)
            mask = None if alive.all() else alive
            _, world.rewards, world.terminateds, world.truncateds, world.infos = world.envs.step(actions, mask=mask)
        if on_step:
            on_step(world, mask=alive)
        terminateds, truncateds = world.terminateds, world.truncateds
        assert terminateds is not None and truncateds is not None, "a step gives both"
        done = alive & (terminateds | truncateds)
        if not done.any():
            continue
        ended = [int(row) for row in np.flatnonzero(done)]
        for row in ended:
            yield row, int(numbers[row])
        if mode == "wait":
            alive = alive & ~done
            continue
        # Also after the last episode: the next run must not step an environment that is over.
        numbers[done] = range(begun, begun + len(ended))
        begun += len(ended)
        seeds = [seed + int(number) if seed is not None and over else None for number, over in zip(numbers, done, strict=True)]
        _, world.infos = world.envs.reset(seed=seeds, options=options, mask=done)
        terminateds[done] = False
        truncateds[done] = False
        world.infos["_needs_flush"] = done
        if on_step:
            on_step(world, mask=done)
        if episodes is not None:
            alive = numbers < episodes


def begin(world: World, seed: int | None, options: Any, on_step: OnStep) -> None:
    """Begin episodes of any seed where `run_iter` would go on with those that are open."""
    if seed is None and options is None:
        world.reset()
        on_step(world, mask=np.ones(world.num_envs, dtype=bool))


def evaluate(
    world: World, episodes: int, seed: int | None, options: Any, video: str | Path | None, mode: str, progress: bool
) -> EvaluationResult:
    """Run episodes and count those that terminate: the reference's measure of success."""
    successes = np.zeros(episodes, dtype=bool)
    seeds = np.zeros(episodes, dtype=np.int64)
    frames: dict[int, list[npt.NDArray[Any]]] = defaultdict(list)

    def on_step(world: World, *, mask: Mask) -> None:
        if video is not None:
            for row in np.flatnonzero(mask):
                frames[int(row)].append(_frame(_images(world)[row]))

    with Progress("Evaluating", episodes, progress) as bar:
        begin(world, seed, options, on_step)
        runs = world._run_iter(episodes=episodes, seed=seed, options=options, mode=mode, on_step=on_step)  # pyright: ignore[reportPrivateUsage]
        for ended, (row, episode) in enumerate(runs, 1):
            assert world.terminateds is not None
            successes[episode] = world.terminateds[row]
            seeds[episode] = world.envs.seeds[row]
            bar.tick(ended, int(successes.sum()), 0)
            if video is not None:
                save_video(Path(video) / f"episode_{episode}.mp4", frames.pop(row, []))
    return _result(world, successes, seeds)


def evaluate_from_dataset(
    world: World,
    dataset: Any,
    episodes_idx: Sequence[int],
    start_steps: Sequence[int],
    goal_offset: int,
    eval_budget: int,
    callables: Sequence[Mapping[str, Any]] | None,
    video: str | Path | None,
    mode: str,
) -> EvaluationResult:
    """Start at recorded rows, aim at later ones: one pair per environment."""
    count = len(episodes_idx)
    if count != world.num_envs:
        raise ValueError(f"{count} pairs for {world.num_envs} environments; environments of others take one pair each")
    firsts, lasts, recorded = extract_init_goal(dataset, episodes_idx, start_steps, goal_offset)
    constants = set(getattr(dataset, "episode_column_names", None) or [])
    seeds = [int(np.asarray(row["seed"]).reshape(-1)[0]) for row in firsts] if "seed" in firsts[0] else None
    handles = [env.unwrapped for env in world.envs.envs]
    if hasattr(handles[0], "reset_options_from_dataset"):
        options = [
            env.reset_options_from_dataset(first, last) for env, first, last in zip(handles, firsts, lasts, strict=True)
        ]
        world.reset(seed=seeds, options=options)
    else:
        world.reset(seed=seeds)
        for env, first, last in zip(handles, firsts, lasts, strict=True):
            apply_callables(env, callables or (), {**first, **last})
    own = set(world.infos)
    goals = _inject(world, firsts, lasts, constants)
    # As the reference has it, they stay in the infos until the next episodes begin, which have no such goals.
    world.envs.table.borrowed.update(set(goals) - own)
    successes = np.zeros(count, dtype=bool)
    frames: dict[int, list[npt.NDArray[Any]]] = defaultdict(list)

    def on_step(world: World, *, mask: Mask) -> None:
        nonlocal successes
        world.infos.update(deepcopy(goals))
        assert world.terminateds is not None
        successes = successes | world.terminateds
        if video is not None:
            for row in range(count):
                frames[row].append(_frame(_images(world)[row]))

    world._run(max_steps=eval_budget, mode=mode, on_step=on_step)  # pyright: ignore[reportPrivateUsage]
    for row, shown in frames.items():
        goal = lasts[row].get("goal")
        panels = [shown, recorded[row] if recorded else None, None if goal is None else [goal] * len(shown)]
        save_video(Path(str(video)) / f"episode_{row}.mp4", _side_by_side(panels))
    return _result(world, successes, seeds)


def _inject(world: World, firsts: list[Any], lasts: list[Any], constants: set[str]) -> dict[str, npt.NDArray[Any]]:
    """Put recorded values into the infos, where all pairs have one shape; gives those of the goals."""
    leading = (world.num_envs, 1)
    for rows in (firsts, lasts):
        for column in rows[0]:
            is_goal = rows is lasts
            if column == "action" or column in constants or (column not in world.infos and not is_goal):
                continue
            values = [row[column] for row in rows]
            is_array = all(isinstance(value, (np.ndarray, np.generic)) for value in values)
            if is_array and len({np.shape(value) for value in values}) == 1:
                stacked = np.stack(values)
                world.infos[column] = stacked.reshape(*leading, *stacked.shape[1:]).copy()
    return {column: world.infos[column].copy() for column in lasts[0] if column in world.infos}


def collect(world: World, writer: Any, episodes: int, seed: int | None, options: Any, progress: bool) -> int:
    """Run episodes and hand each to a writer in order, as a dict of lists with one value per step; gives the number of steps."""
    steps = 0
    recorder = EpisodeRecorder(world.num_envs)

    def on_step(world: World, *, mask: Mask) -> None:
        recorder.keep(world.envs.table, mask)

    def finished(bar: Progress) -> Iterator[dict[str, Any]]:
        nonlocal steps
        # Those that ended before one that began earlier.
        waiting: dict[int, dict[str, Any]] = {}
        written = 0
        begin(world, seed, options, on_step)
        runs = world._run_iter(episodes=episodes, seed=seed, options=options, mode="auto", on_step=on_step)  # pyright: ignore[reportPrivateUsage]
        for ended, (row, number) in enumerate(runs, 1):
            episode: dict[str, Any] = dict(recorder.finish(world.envs.table, row))
            steps += max(map(len, episode.values()), default=0)
            constants = getattr(world.envs.envs[row].unwrapped, "get_episode_data", None)
            if constants is not None and (given := constants()):
                episode[EPISODE_DATA_KEY] = dict(given)
            bar.tick(ended, 0, steps)
            waiting[number] = episode
            while written in waiting:
                yield waiting.pop(written)
                written += 1

    from ..data.writers import NativeWriter

    if isinstance(writer, NativeWriter) and writer.metadata is None:
        writer.metadata = recorded_by(world, seed)
    opened = writer if hasattr(writer, "__enter__") else nullcontext(writer)
    with opened as target, Progress("Recording", episodes, progress) as bar:
        target.write_episodes(finished(bar))
    return steps


def name_of(env: Any) -> str:
    """What an environment is called in records: its id in gymnasium, else its class."""
    spec = getattr(env, "spec", None)
    pool = getattr(env.unwrapped, "pool", None)
    if isinstance(pool, NativePool):
        return pool.core.id
    if spec is not None:
        is_theirs = type(env.unwrapped).__module__.partition(".")[0] == "stable_worldmodel"
        return recorded_id(spec.id, is_of_reference=is_theirs)
    return type(env.unwrapped).__name__


def recorded_by(world: World, seed: int | None) -> dict[str, Any]:
    """What a dataset says of its recording: the environment and the policy."""
    return {
        "version": _METADATA_VERSION,
        "env": name_of(world.envs.envs[0]),
        "policy": describe(world.policy),
        "seed": 0 if seed is None else int(seed),
        # No run of the core: its seed alone does not make the same episodes.
        "from_recorded_rows": True,
    }


def save_video(path: Path, frames: Sequence[npt.NDArray[Any]]) -> None:
    """Write frames ``(H, W, 3)`` u8 as a video."""
    from .._core import core as _swm

    if frames:
        path.parent.mkdir(parents=True, exist_ok=True)
        _swm.save_video(str(path), np.ascontiguousarray(np.stack(frames)), float(_FRAMES_PER_SECOND))


def _images(world: World) -> Any:
    if "pixels" not in world.infos:
        raise ValueError(f"a video needs images, and {world.envs.envs[0].unwrapped} has none here; make the World with image_shape=(height, width)")
    return world.infos["pixels"]


def _frame(pixels: Any) -> npt.NDArray[Any]:
    last = pixels[-1] if pixels.ndim > 3 else pixels
    return np.array(last)


def _side_by_side(panels: Sequence[Any]) -> list[npt.NDArray[Any]]:
    """Videos beside each other, each as long as the first; shorter ones stand still at their end."""
    shown = [list(panel) for panel in panels if panel is not None and len(panel)]
    return [
        np.concatenate([panel[min(step, len(panel) - 1)] for panel in shown], axis=1) for step in range(len(shown[0]))
    ]


def _result(world: World, successes: Mask, seeds: Any) -> EvaluationResult:
    from .._core import core as _swm

    won, count = int(successes.sum()), len(successes)
    return EvaluationResult(
        success_rate=100.0 * won / max(count, 1),
        episode_successes=successes,
        seeds=seeds,
        interval=_swm.wilson95(won, count),
        episodes=count,
        setup={"env": name_of(world.envs.envs[0]), "policy": describe(world.policy)},
    )

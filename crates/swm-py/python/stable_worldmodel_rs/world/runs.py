"""Runs of a World: evaluations and recordings, in Rust where its environments are."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from .._access import access_checked
from .._arguments import target_path
from .._core import core as _swm
from .._progress import Progress
from .._requests import log_notes
from . import foreign
from .ids import explicit
from .native import note_unsampled, plain_options, whole
from .policies import NativePolicy, ask, explains_actions
from .results import EvaluationResult
from .rows import check_callables, check_recording, extract_init_goal, goal_images, reset_options

if TYPE_CHECKING:
    from ..track import Tracker
    from .world import World

Flags = npt.NDArray[np.bool_]
logger: logging.Logger = logging.getLogger("stable_worldmodel_rs")
# Rows from one state to the next, where recordings are replayable and none is given: as of the command.
_ROWS_OF_CHECKPOINT = 16
# Episodes that begin at recorded rows have this seed unless another is given, as in the command.
_DATASET_SEED = 42


class Runs:
    """What `World` does with whole episodes."""

    envs: Any
    policy: Any
    infos: dict[str, Any]
    _core: _swm.World | None = None
    _stale = False
    _transforms: dict[str, Callable[[Any], Any]] = {}
    _built: dict[str, Any] = {}

    @explains_actions
    @access_checked
    def evaluate(
        self,
        episodes: int | None = None,
        seed: int | None = None,
        options: Any = None,
        video: str | Path | None = None,
        reset_mode: str | None = None,
        dataset: Any = None,
        episodes_idx: Sequence[int] | None = None,
        start_steps: Sequence[int] | None = None,
        goal_offset: int | None = None,
        eval_budget: int | None = None,
        callables: Sequence[Mapping[str, Any]] | None = None,
        progress: bool = False,
        tracker: Tracker | None = None,
    ) -> EvaluationResult:
        """Run the policy and count successes.

        Args:
            episodes: Episodes to run: exactly these of the run with this seed, whatever the number of environments.
            seed: Seed of the run; None: any.
            options: Reset options for all, or a list with one dict per episode.
            video: A folder for a video of every episode.
            reset_mode: ``"auto"`` or ``"wait"``; results are the same for environments of this package.
            dataset: Start at recorded rows: with ``episodes_idx``, ``start_steps`` (one of each per episode),
                ``goal_offset`` (the goal is so many rows later) and ``eval_budget`` (actions allowed).
            callables: Set-up calls of the reference; for environments of this package they are implied.
            progress: Whether to show a bar.
            tracker: Where the success rate with its interval, the result and its videos go, too: what `swm.track.start` gave.

        Returns:
            A dict with ``success_rate`` (percent), ``episode_successes``, ``seeds``, ``interval`` and more.
        """
        video = None if video is None else target_path("video", video)
        result = self._evaluate(
            episodes, seed, options, video, reset_mode, dataset, episodes_idx, start_steps, goal_offset, eval_budget, callables, progress
        )
        if tracker is not None:
            tracker.evaluation(result)
        return result

    def _evaluate(
        self,
        episodes: int | None,
        seed: int | None,
        options: Any,
        video: str | Path | None,
        reset_mode: str | None,
        dataset: Any,
        episodes_idx: Sequence[int] | None,
        start_steps: Sequence[int] | None,
        goal_offset: int | None,
        eval_budget: int | None,
        callables: Sequence[Mapping[str, Any]] | None,
        progress: bool,
    ) -> EvaluationResult:
        if reset_mode not in (None, "auto", "wait"):
            raise ValueError(f"reset_mode must be 'auto' or 'wait', found {reset_mode!r}")
        if dataset is not None:
            if episodes_idx is None or start_steps is None or goal_offset is None or eval_budget is None:
                raise ValueError(
                    "an evaluation from a dataset needs episodes_idx, start_steps, goal_offset and eval_budget; "
                    "swm.evaluate_from_dataset chooses rows itself"
                )
            return self._evaluate_rows(
                dataset, episodes_idx, start_steps, goal_offset, eval_budget, callables, video, reset_mode, seed, progress
            )
        if episodes is None:
            raise ValueError("evaluate needs episodes=, the number of episodes, or dataset=")
        episodes = whole("episodes", episodes, least=1)
        if self._core is None:
            return foreign.evaluate(cast("World", self), episodes, seed, options, video, reset_mode or "auto", progress)
        _note_options(self._core, options)
        return self._evaluate_native(episodes, self.envs.run_seed(seed), options, None, None, video, progress)

    def _evaluate_rows(
        self,
        dataset: Any,
        episodes_idx: Sequence[int],
        start_steps: Sequence[int],
        goal_offset: int,
        eval_budget: int,
        callables: Sequence[Mapping[str, Any]] | None,
        video: str | Path | None,
        reset_mode: str | None,
        seed: int | None,
        progress: bool,
    ) -> EvaluationResult:
        if len(episodes_idx) != len(start_steps):
            raise ValueError(f"{len(episodes_idx)} episodes_idx and {len(start_steps)} start_steps; give one of each per pair")
        whole("eval_budget", eval_budget, least=1)
        whole("goal_offset", goal_offset)
        if self._core is None:
            mode = reset_mode or "wait"
            return foreign.evaluate_from_dataset(
                cast("World", self), dataset, episodes_idx, start_steps, goal_offset, eval_budget, callables, video, mode
            )
        check_callables(callables)
        check_recording(dataset, self._built["id"], self._built["frame_skip"])
        reader = getattr(dataset, "reader", None)
        if isinstance(reader, _swm.Reader):
            reader.check_fit(self._built["id"], self._built["settings"])
        firsts, lasts, _ = extract_init_goal(dataset, episodes_idx, start_steps, goal_offset)
        spec = self.envs.spec_data
        options = [reset_options(spec, first, last) for first, last in zip(firsts, lasts, strict=True)]
        rendered = goal_images(dataset, spec, self._built, lasts[0], self._core.renderer()) if lasts else ""
        if rendered is None:
            for one, last in zip(options, lasts, strict=True):
                one["goal_image"] = last["goal"]
        elif rendered:
            logger.warning("images of goals are rendered from the recorded states, as %s", rendered)
        run = _DATASET_SEED if seed is None else seed
        seeds = [
            _swm.episode_seed(run, int(episode) << 32 | int(row))
            for episode, row in zip(episodes_idx, start_steps, strict=True)
        ]
        return self._evaluate_native(len(options), run, options, seeds, eval_budget, video, progress)

    def _evaluate_native(
        self,
        episodes: int,
        seed: int,
        options: Any,
        seeds: list[int] | None,
        limit: int | None,
        video: str | Path | None,
        progress: bool,
    ) -> EvaluationResult:
        assert self._core is not None, "callers have checked"
        act = self._driver(options)
        folder = None if video is None else str(video)
        with Progress("Evaluating", episodes, progress) as bar:
            text, videos = _swm.evaluate(
                self._core, act, (0, episodes), seed, _listed(options), seeds, limit, folder, bar.tick
            )
        self._stale = True
        return EvaluationResult.from_json(text, videos)

    @explains_actions
    @access_checked
    def collect(
        self,
        path: str | Path | None = None,
        episodes: int = 0,
        seed: int | None = None,
        options: Any = None,
        format: str | None = None,
        writer: Any = None,
        progress: bool = True,
        *,
        mode: str = "error",
        quality: int | None = None,
        replayable: int | bool | None = None,
        check: bool = False,
        mix: bool = False,
        total: int | None = None,
    ) -> dict[str, Any]:
        """Record episodes of the policy: exactly ``episodes`` of them, safe as soon as each is written.

        Args:
            path: File or folder of the dataset; or give ``writer``.
            episodes: How many; with ``mode="append"``, this many more.
            seed: Seed of the run; None: any. The file says which.
            options: Reset options for all, or a list with one dict per episode.
            format: ``"hdf5"``, ``"folder"``, ``"video"``, ``"lerobot"``, …; None: by the suffix of the path, else HDF5.
            writer: In place of a path: an object with ``write_episodes(episodes)``, such as a `ReplayBuffer`; it gets
                dicts of arrays ``(T, …)``.
            progress: Whether to show a bar.
            mode: If the file exists: ``"append"``, ``"overwrite"`` or ``"error"``.
            quality: Quality of images in lossy formats, 1 to 100.
            replayable: Record simulator states every so many steps (True: 16) in place of images, which are rendered when read.
            check: Replay the new episodes afterwards, as `replay` does: environments of this package, into a file.
            mix: With ``mode="append"``: allow episodes of another policy, seed or shard in a part of a divided recording.
            total: In place of ``episodes``: record until the dataset holds this many, the same ones as in one run.

        Returns:
            ``path``, ``episodes``, ``total_episodes`` and ``steps`` of what was written.

        Raises:
            DataError: ``check`` found that the simulator gives something else than what was recorded; the file stays.
        """
        if (path is None) == (writer is None):
            raise ValueError("World.collect: pass exactly one of `path` or `writer`.")
        if total is not None and episodes:
            raise ValueError(f"World.collect: episodes={episodes} and total={total}; leave one of them out")
        if total is not None and (self._core is None or writer is not None):
            raise TypeError(f"World.collect: total={total} counts episodes in files that the core writes, of environments of this package")
        asked = ("episodes", episodes) if total is None else ("total", total)
        whole(*asked, least=1)
        target = Path() if path is None else target_path("path", path)
        if path is not None:
            target.parent.mkdir(parents=True, exist_ok=True)
            by_name = _native_formats().get(target.suffix)
            if format is not None and by_name not in (None, format):
                logger.warning("%s: its name is that of the format %s, and %s is written", target, by_name, format)
            format = format or _format_of(target)
            if self._core is None or format not in _native_formats().values():
                from ..data.format import get_format

                writer = get_format(format).open_writer(target, mode=mode)
        if check and (self._core is None or writer is not None):
            raise TypeError("check=True replays a file that the core has written, of environments of this package")
        every = None if replayable is False else _ROWS_OF_CHECKPOINT if replayable is True else replayable
        if self._core is None and every is not None:
            raise TypeError("replayable= records states of environments of this package, and these are none; leave it out")
        if self._core is None:
            steps = foreign.collect(cast("World", self), writer, episodes, seed, options, progress)
            return _written(path, format, mode, episodes, steps)
        core = self._core if every is None else self._replayable(every)
        _note_options(core, options)
        run = self.envs.run_seed(seed)
        act = self._driver(options)
        with Progress("Recording", asked[1], progress) as bar:
            if writer is not None:
                steps = self._collect_into(writer, core, act, episodes, run, options, bar)
                return _written(path, format, mode, episodes, steps)
            request = {
                "env": self._built["id"],
                "episodes": int(episodes) if total is None else None,
                "total": None if total is None else int(total),
                "seed": run,
                "out": str(target),
                "format": format,
                "quality": quality,
                "mode": mode,
                "mix": mix,
            }
            text, notes = _swm.collect(core, act, json.dumps(request), _listed(options), bar.tick)
        self._stale = True
        written: dict[str, Any] = json.loads(text)
        log_notes(notes)
        new, held = int(written["episodes"]), int(written["total_episodes"])
        logger.info("%s: %d episodes recorded, it has %d", target, new, held)
        if check:
            from .requests import replay

            found = replay(target, range(held - new, held), tolerance=0.0, env_name=explicit(self._built["id"]), progress=progress)
            if not found["ok"]:
                raise _swm.DataError(f"{target}: a replay of the new episodes differs from what was recorded: {found}")
        return written

    def _collect_into(
        self, writer: Any, core: _swm.World, act: Any, episodes: int, seed: int, options: Any, bar: Progress
    ) -> int:
        steps = 0

        def finished(run: Any) -> Iterator[dict[str, Any]]:
            nonlocal steps
            for number, episode in enumerate(run):
                steps += len(episode["action"])
                bar.tick(number + 1, 0, steps)
                yield episode

        with writer if hasattr(writer, "__enter__") else nullcontext(writer) as opened:
            # What a writer continues is recorded even where this run does not vary it.
            held = list(getattr(opened, "_known", None) or ())
            run = _swm.episodes(core, act, (0, episodes), seed, _listed(options), held)
            try:
                opened.write_episodes(finished(run))
            finally:
                run.close()
        self._stale = True
        return steps

    def _replayable(self, every: int) -> _swm.World:
        """A World as this one that saves states and renders nothing."""
        if not isinstance(self.policy, NativePolicy):
            raise TypeError("replayable= runs a World without images, which only policies of the core can do without")
        built: dict[str, Any] = {**self._built, "image": None, "checkpoints": whole("replayable", every, 2**32 - 1)}
        core = _swm.World(**built)
        core.set_policy(self.policy.text)
        core.set_policy_seed(self.policy.seed)
        return core

    def _driver(self, options: Any) -> Callable[[Flags | None], Any] | None:
        """Who acts in a native run: None for a policy of the core."""
        if self.policy is None:
            raise RuntimeError("No policy set. Call world.set_policy(...) first.")
        self.envs.prepare(options)
        self.infos = self.envs.infos
        return None if isinstance(self.policy, NativePolicy) else self._act

    def _act(self, begun: Flags | None) -> Any:
        """Ask the policy, in a native run; ``begun``: environments that have begun another episode."""
        infos = self.infos
        if begun is not None:
            infos["_needs_flush"] = begun
        elif "_needs_flush" in infos:
            del infos["_needs_flush"]
        if self._transforms:
            self._show()
        return ask(self.policy, infos, self.envs.action_space)

    def _show(self) -> None:
        """Replace images of the infos by transformed ones."""


def _written(path: str | Path | None, format: str | None, mode: str, episodes: int, steps: int) -> dict[str, Any]:
    """What `collect` says of what a writer wrote."""
    if path is None:
        return {"path": None, "episodes": episodes, "total_episodes": episodes, "steps": steps}
    target, total = Path(path).expanduser(), episodes
    if mode == "append" and format in _native_formats().values():
        total = len(_swm.Reader.open(target, format).lengths)
    logger.info("%s: %d episodes recorded, it has %d", target, episodes, total)
    return {"path": str(target), "episodes": episodes, "total_episodes": total, "steps": steps}


def _note_options(core: _swm.World, options: Any) -> None:
    """Tell of factors that options of all episodes leave at their defaults. A list says what it wants of each episode."""
    if isinstance(options, Mapping):
        note_unsampled(core.unsampled_defaults(plain_options(cast("Mapping[str, Any]", options))))


def _listed(options: Any) -> Any:
    """Options of single episodes as a list, which the core tells from a dict for all."""
    if options is None or isinstance(options, Mapping):
        return plain_options(cast("Mapping[str, Any] | None", options))
    return [plain_options(one) for one in options]


@cache
def _native_formats() -> dict[str, str]:
    """Suffix -> name of the formats that the core writes."""
    return {f".{suffix}": name for name, _, suffixes in _swm.dataset_formats() for suffix in (*suffixes, name)}


def _format_of(path: Path) -> str:
    """The format that a path's suffix names; HDF5 where it has none."""
    return _native_formats().get(path.suffix, path.suffix.lstrip(".")) or "hdf5"

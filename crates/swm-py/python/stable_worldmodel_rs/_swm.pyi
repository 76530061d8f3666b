"""The compiled half of the package. Import `stable_worldmodel_rs` instead; what is here may change with any version."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, TypeAlias, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "BatchStream",
    "ClipReader",
    "DataError",
    "EnvError",
    "EpisodeWriter",
    "Episodes",
    "HAS_TRAINING",
    "PlanError",
    "PolicyError",
    "Reader",
    "Solver",
    "SwmError",
    "Table",
    "World",
    "__version__",
    "choose_starts",
    "collect",
    "compare_receipts",
    "contact_sheet",
    "dataset_formats",
    "detect_dataset",
    "divisors",
    "env_aliases",
    "env_ids",
    "environments",
    "episode_seed",
    "episodes",
    "evaluate",
    "evaluate_manifest",
    "files",
    "held_out",
    "is_remote",
    "make_manifest",
    "manifest_json",
    "receipt_differences",
    "receipt_json",
    "receipt_to_repeat",
    "recipes",
    "row_statistics",
    "run_command",
    "run_request",
    "save_video",
    "set_files",
    "set_zoo",
    "solvers",
    "sweep_json",
    "sweep_manifest",
    "verify_receipt",
    "wilson95",
    "yaml_config",
    "zoo_model",
    "zoo_models",
]
__version__: str
HAS_TRAINING: bool

_Path: TypeAlias = str | PathLike[str]
_Array: TypeAlias = npt.NDArray[Any]
# name, dtype ("f32", …), shape of one row, "step" or "episode"
_Field: TypeAlias = tuple[str, str, list[int], str]
# Chooses the actions of one step: gets nothing (the infos are written), returns (N, …).
_Act: TypeAlias = Callable[..., Any]
_Tick: TypeAlias = Callable[..., Any]
_Begin: TypeAlias = Callable[[str, int, str], object]
# A slot, the run's seed, the episode's index, the episode's own seed, reset options.
_Reset: TypeAlias = tuple[int, int, int, int | None, Mapping[str, Any] | None]
# Weights of four kinds of goals, the discount, the longest distance, columns, the seed.
_Goals: TypeAlias = tuple[tuple[float, float, float, float], float, int | None, Sequence[str] | None, int]

# A policy in Python: its World, what is called before episodes begin, its actions, its settings (JSON), its files.
_Given: TypeAlias = tuple["World", Callable[[], object], _Act, str, Sequence[_Path]]

class SwmError(ValueError):
    """Whatever this package refuses; its message names the fix."""

class EnvError(SwmError):
    """An environment cannot be made, reset or stepped."""

class PolicyError(SwmError):
    """A policy cannot be made or cannot act."""

class DataError(SwmError):
    """A dataset cannot be read or written."""

class PlanError(SwmError):
    """A solver or a cost refuses its input."""

@final
class Table:
    """The owner of the memory behind the arrays of a World's infos."""

@final
class World:
    """Environments of one kind, stepped together; `stable_worldmodel_rs.World` is built on it."""

    def __new__(
        cls,
        id: str,
        num_envs: int,
        image: tuple[int, int] | None = None,
        max_episode_steps: int | None = None,
        frame_skip: int = 1,
        threads: int | None = None,
        settings: str = "{}",
        unrecorded: Sequence[str] | None = None,
        checkpoints: int | None = None,
    ) -> World: ...
    @property
    def id(self) -> str: ...
    @property
    def num_envs(self) -> int: ...
    @property
    def closed(self) -> bool: ...
    def spec_json(self) -> str: ...
    def renderer(self) -> str | None: ...
    def infos(self) -> dict[str, _Array]: ...
    def results(self) -> dict[str, _Array]: ...
    def reset(self, resets: Sequence[_Reset]) -> None: ...
    def unsampled_defaults(self, options: Any) -> list[str]: ...
    def sampled_factors(self, asked: Sequence[str] | None = None) -> list[str]: ...
    def step(self, actions: Any = None, mask: Sequence[bool] | None = None) -> None: ...
    def set_policy(self, text: str | None = None, foreign: str | None = None) -> str: ...
    def notes_on(self, policy: str) -> list[str]: ...
    def set_policy_seed(self, seed: int) -> None: ...
    def save(self) -> list[bytes | None]: ...
    def restore(self, saved: Sequence[bytes | None]) -> None: ...
    def set_success(self, rule: str) -> None: ...
    def set_distractors(self, distractors: Sequence[str]) -> None: ...
    def set_max_episode_steps(self, limit: int | None) -> int | None: ...
    def close(self) -> None: ...

@final
class Episodes:
    """Whole episodes of a run, as dicts of arrays ``(T, …)``."""

    def __iter__(self) -> Episodes: ...
    def __next__(self) -> dict[str, Any]: ...
    def close(self) -> None: ...

@final
class Reader:
    """A dataset of any format, opened; `data.Dataset` is built on it."""

    @staticmethod
    def open(path: _Path, format: str | None = None, options: str | None = None) -> Reader: ...
    @staticmethod
    def memory(
        name: str, lengths: Sequence[int], columns: Sequence[tuple[str, Any]], metadata: str | None = None
    ) -> Reader: ...
    @staticmethod
    def concat(readers: Sequence[Reader]) -> Reader: ...
    @property
    def path(self) -> Path: ...
    @property
    def format(self) -> str: ...
    @property
    def fields(self) -> list[_Field]: ...
    @property
    def lengths(self) -> npt.NDArray[np.int64]: ...
    @property
    def runs(self) -> str: ...
    @property
    def skipped(self) -> list[tuple[str, str]]: ...
    @property
    def mapping(self) -> dict[str, str]: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def has_checksums(self) -> bool: ...
    def beside(self, other: Reader) -> Reader: ...
    def subset(self, episodes: Sequence[int]) -> Reader: ...
    def cached(self, keys: Sequence[str]) -> Reader: ...
    def rendered(
        self,
        image: tuple[int, int],
        settings: str = "{}",
        factors: str = "{}",
        looks: str | None = None,
        canonical: str | None = None,
    ) -> Reader: ...
    def check_fit(self, env: str, settings: str) -> None: ...
    def resized(self, image: tuple[int, int], fit: str | None = None) -> Reader: ...
    def slice(self, episode: int, start: int, stop: int, frameskip: int, columns: Sequence[int]) -> list[Any]: ...
    def column(self, column: int) -> Any: ...
    def gather(self, rows: Sequence[tuple[int, int]], columns: Sequence[int]) -> list[Any]: ...
    def statistics(self, keys: Sequence[str] | None = None, quantiles: Sequence[float] | None = None) -> str: ...
    def verify(self) -> str: ...

@final
class ClipReader:
    """Clips of a dataset, one by one or in batches."""

    def __new__(
        cls,
        reader: Reader,
        num_steps: int = 1,
        frameskip: int = 1,
        keys: Sequence[str] | None = None,
        channels_first: bool = True,
        image: tuple[int, int] | None = None,
        paper: bool = False,
        threads: int | None = None,
        goals: _Goals | None = None,
        action_rewards: bool = False,
        float32: bool = False,
        cache_limit: int | None = None,
    ) -> ClipReader: ...
    def __len__(self) -> int: ...
    @property
    def fields(self) -> list[_Field]: ...
    @property
    def cached(self) -> list[tuple[str, bool]]: ...
    def clip(self, index: int) -> tuple[int, int] | None: ...
    def goal(self, index: int, epoch: int) -> tuple[int, int] | None: ...
    def read(self, indices: Sequence[int], epoch: int = 0) -> dict[str, Any]: ...
    def batches(
        self,
        size: int,
        shuffle: int | None = None,
        drop_last: bool = False,
        epochs: int | None = None,
        ahead: int = 2,
        shard: tuple[int, int] = ...,
        position: str | None = None,
        make_table: Callable[..., Any] | None = None,
    ) -> BatchStream: ...

@final
class BatchStream:
    """Batches of clips, read ahead by threads."""

    def next(self) -> Any: ...
    def position(self) -> str: ...
    def skip(self, batches: int) -> int: ...
    def close(self) -> None: ...

@final
class EpisodeWriter:
    """Writes episodes to a dataset; a written one survives a crash."""

    def __new__(
        cls,
        path: _Path,
        format: str | None = None,
        mode: str = "append",
        metadata: str | None = None,
        quality: int | None = None,
        fps: float | None = None,
        key_frame_period: int | None = None,
        last_row: str | None = None,
    ) -> EpisodeWriter: ...
    def write_episode(self, columns: Sequence[tuple[str, Any]], constant: Sequence[str] = ...) -> None: ...
    def finish(self) -> None: ...

class _Bridge(Protocol):
    """A cost in Python, as a solver calls it: candidates ``(B, S, H, D)`` in, costs out."""

    def evaluate(self, candidates: _Array, /) -> _Array: ...

@final
class Solver:
    """A solver of the core with its settings."""

    def __new__(cls, name: str, settings: str) -> Solver: ...
    def changed_settings(self) -> str: ...
    def solve(
        self,
        task: Mapping[str, Any],
        bridge: _Bridge,
        *,
        has_gradient: bool,
        constraints: int,
        evaluations: int,
        traced: bool,
    ) -> dict[str, Any]: ...

def choose_starts(lengths: Sequence[int], count: int, goal_offset: int, seed: int) -> list[list[int]]: ...
def collect(
    world: World, act: _Act | None, request: str, options: Any | None = None, tick: _Tick | None = None
) -> tuple[str, list[str]]: ...
def compare_receipts(sides: Sequence[tuple[str, Sequence[str]]]) -> str: ...
def contact_sheet(frames: npt.NDArray[np.uint8]) -> bytes: ...
def divisors(
    centers: npt.NDArray[np.float64], scales: npt.NDArray[np.float64], absolute: float
) -> npt.NDArray[np.float64]: ...
def dataset_formats() -> list[tuple[str, str, list[str]]]: ...
def detect_dataset(path: _Path) -> str | None: ...
def is_remote(path: _Path) -> bool: ...
def env_ids() -> list[tuple[str, str]]: ...
def env_aliases() -> list[tuple[str, str]]: ...
def environments() -> str: ...
def episode_seed(run: int, index: int) -> int: ...
def episodes(
    world: World,
    act: _Act | None,
    episodes: tuple[int, int],
    seed: int,
    options: Any | None = None,
    held: Sequence[str] = ...,
) -> Episodes: ...
def evaluate(
    world: World,
    act: _Act | None,
    episodes: tuple[int, int],
    seed: int,
    options: Any | None = None,
    seeds: Sequence[int | None] | None = None,
    limit: int | None = None,
    video: str | None = None,
    tick: _Tick | None = None,
) -> tuple[str, list[str]]: ...
def evaluate_manifest(
    request: str,
    policy: _Given | None = None,
    begin: _Begin | None = None,
    tick: _Tick | None = None,
) -> tuple[str | None, list[str]]: ...
def files() -> tuple[Path | None, Path | None, list[str]]: ...
def held_out(episodes: list[int], share: float) -> list[bool]: ...
def make_manifest(request: str) -> tuple[str, str, list[str]]: ...
def manifest_json(path: _Path) -> tuple[str, str]: ...
def receipt_differences(first: str, this: str) -> str: ...
def receipt_json(path: _Path) -> str: ...
def receipt_to_repeat(path: _Path) -> str: ...
def recipes() -> str: ...
def row_statistics(rows: npt.NDArray[np.float64], dim: int, quantiles: list[float]) -> list[list[float]]: ...
def run_command(arguments: Sequence[_Path], launcher: tuple[list[str], _Path] | None = None) -> int: ...
def run_request(
    name: str, request: str, begin: _Begin | None = None, tick: _Tick | None = None
) -> tuple[str, list[str]]: ...
def save_video(path: str, frames: npt.NDArray[np.uint8], frames_per_second: float) -> None: ...
def set_files(
    library: _Path | None = None, folder: _Path | None = None, fix: str | None = None, python: _Path | None = None
) -> None: ...
def set_zoo(folders: Sequence[_Path], advice: str) -> None: ...
def solvers() -> list[tuple[str, str, list[tuple[str, str, str]]]]: ...
def sweep_json(path: _Path) -> str: ...
def sweep_manifest(
    request: str,
    policy: _Given | None = None,
    begin: _Begin | None = None,
    tick: _Tick | None = None,
) -> tuple[str | None, list[str]]: ...
def verify_receipt(
    receipt: str,
    policy: tuple[str, _Given] | None = None,
    plan_steps: int | None = None,
    num_envs: int = 8,
    threads: int | None = None,
    oracle: bool = False,
    tick: _Tick | None = None,
) -> str: ...
def wilson95(successes: int, episodes: int) -> tuple[float, float]: ...
def yaml_config(text: str) -> str: ...
def zoo_model(name: str) -> str: ...
def zoo_models() -> tuple[str, list[str]]: ...

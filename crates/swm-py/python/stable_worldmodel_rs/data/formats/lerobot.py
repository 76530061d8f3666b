"""LeRobot datasets (v2.1 and v3.0), read and written without the package ``lerobot``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from .._paths import datasets_folder
from ..dataset import Transform
from ..format import Format, register_format
from ..native import NativeDataset
from ..writers import NativeWriter

__all__ = ["LeRobot", "LeRobotAdapter", "LeRobotWriter"]
SCHEME = "lerobot://"


class LeRobotAdapter(NativeDataset):
    """Clips of a LeRobot dataset that is on this machine.

    The first camera is ``pixels``, ``observation.state`` is ``proprio``; other columns keep their names.

    Args:
        repo_id: The folder, or the id of a repository that ``swm.data.download(repo_id)`` has fetched.
        root: The folder, if ``repo_id`` is no path.
        episodes: The episodes to take; ``None``: all.

    The other arguments are those of :class:`~stable_worldmodel_rs.data.native.NativeDataset`.
    """

    native_format: ClassVar[str | None] = "lerobot"

    def __init__(
        self,
        repo_id: str | Path,
        root: str | Path | None = None,
        episodes: Sequence[int] | None = None,
        frameskip: int = 1,
        num_steps: int = 1,
        transform: Transform | None = None,
        keys_to_load: Sequence[str] | None = None,
        keys_to_cache: Sequence[str] | None = None,
        primary_camera_key: str | None = None,
        key_aliases: dict[str, str] | None = None,
        **options: Any,
    ) -> None:
        if primary_camera_key or key_aliases:
            raise ValueError("primary_camera_key and key_aliases are not supported: rename columns in transform=")
        self.repo_id: str = str(repo_id)
        super().__init__(
            locate(self.repo_id, root),
            frameskip=frameskip,
            num_steps=num_steps,
            transform=transform,
            keys_to_load=keys_to_load,
            keys_to_cache=keys_to_cache,
            episodes=episodes,
            **options,
        )


def locate(repo_id: str, root: str | Path | None) -> Path:
    """The folder of a repository."""
    places = [Path(root)] if root is not None else [Path(repo_id), datasets_folder() / repo_id.replace("/", "--")]
    for place in places:
        if place.is_dir():
            return place
    if places[0].exists():
        raise ValueError(f"{places[0]} is a file, and a LeRobot dataset is a folder with `meta/info.json`; give that folder, or leave out format=")
    raise FileNotFoundError(f"LeRobot dataset {repo_id!r} is not at {places[-1]}; fetch it with swm.data.download({repo_id!r})")


class LeRobotWriter(NativeWriter):
    """Appends episodes to a LeRobot v3.0 dataset; images become videos, the column ``task`` becomes the texts of tasks.

    Args:
        last_row: ``"drop"``: a last row of an episode without an action (NaN) is left out of the tables that LeRobot trains
            on, and is beside them; it is read back here. ``"keep"``: it is a row like the others. None: ``"drop"``, or as
            the dataset that is continued has it.

    The other arguments are those of :class:`~stable_worldmodel_rs.data.writers.NativeWriter`.
    """

    native_format: ClassVar[str] = "lerobot"
    _marker = "meta/info.json"

    def __init__(self, path: str | Path, *, last_row: str | None = None, **options: Any) -> None:
        super().__init__(path, **options)
        self.last_row: str | None = last_row


@register_format
class LeRobot(Format):
    """LeRobot datasets: ``lerobot://<repo id>``, or a folder."""

    name = "lerobot"

    @classmethod
    def detect(cls, path: str | Path) -> bool:
        """By the scheme, or by ``meta/info.json``."""
        return str(path).startswith(SCHEME) or (Path(path) / "meta" / "info.json").exists()

    @classmethod
    def open_reader(cls, path: str | Path, **kwargs: Any) -> LeRobotAdapter:
        """A dataset of the folder or repository."""
        return LeRobotAdapter(str(path).removeprefix(SCHEME), **kwargs)

    @classmethod
    def open_writer(cls, path: str | Path, **kwargs: Any) -> LeRobotWriter:
        """A writer of the folder."""
        return LeRobotWriter(path, **kwargs)

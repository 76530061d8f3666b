"""Clips with a sampled goal: hindsight, random, or the present."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

KINDS = ("random", "geometric_future", "uniform_future", "current")


class GoalDataset:
    """Adds a goal to every clip of a dataset: a row of the dataset under other names.

    A clip stands at its row ``current_goal_offset`` (counted from 1). Its goal is a random row of any episode, a later
    row of its own (near ones more often, or all equally often), or that row itself. Goals are sampled anew at every
    access. :class:`~stable_worldmodel_rs.data.Loader` reads the same goals natively with ``goals=``, and there they
    depend on the seed, the epoch and the clip alone.

    Args:
        dataset: The clips.
        goal_probabilities: Of a random, a geometric, a uniform and the current goal; they sum to 1.
        gamma: Discount of geometric goals: k frame skips ahead with k ~ Geom(1 - gamma), cut at the episode's end.
        current_goal_offset: Which row of a clip is the current one; by default the last, ``dataset.num_steps``.
        goal_keys: ``{column: name of the goal}``; by default ``pixels`` and ``proprio`` as ``goal_pixels``,
            ``goal_proprio``, as far as they exist.
        seed: Of the choice. Each worker of a ``DataLoader`` has goals of its own, which depend on torch's seed of that
            worker and epoch, too.
    """

    def __init__(
        self,
        dataset: Any,
        goal_probabilities: tuple[float, float, float, float] = (0.3, 0.5, 0.0, 0.2),
        gamma: float = 0.99,
        current_goal_offset: int | None = None,
        goal_keys: dict[str, str] | None = None,
        seed: int | None = None,
    ) -> None:
        if len(goal_probabilities) != len(KINDS):
            raise ValueError(f"goal_probabilities must be a 4-tuple {KINDS}, not {goal_probabilities}")
        if min(goal_probabilities) < 0:
            raise ValueError(f"goal_probabilities must be 0 or more, not {goal_probabilities}")
        if not np.isclose(sum(goal_probabilities), 1.0):
            raise ValueError(f"goal_probabilities must sum to 1.0, {goal_probabilities} sum to {sum(goal_probabilities)}")
        if not 0 <= gamma <= 1:
            raise ValueError(f"gamma must be from 0 to 1, not {gamma}")
        if current_goal_offset is not None and current_goal_offset < 1:
            raise ValueError(f"current_goal_offset={current_goal_offset}: rows of a clip are counted from 1")
        missing = [key for key in goal_keys or () if key not in dataset.column_names]
        if missing:
            raise ValueError(f"goal_keys: there is no column {missing[0]!r}; the columns are {list(dataset.column_names)}")
        self.dataset = dataset
        self.current_goal_offset: int = dataset.num_steps if current_goal_offset is None else current_goal_offset
        self.goal_probabilities = goal_probabilities
        self.gamma = gamma
        self.seed = seed
        self.rng: np.random.Generator = np.random.default_rng(seed)
        self._worker_seed: int | None = None
        self.episode_lengths: NDArray[Any] = dataset.lengths
        self.episode_offsets: NDArray[Any] = dataset.offsets
        self._ends = np.cumsum(self.episode_lengths)
        if goal_keys is None:
            names = dataset.column_names
            goal_keys = {key: f"goal_{key}" for key in ("pixels", "proprio") if key in names}
        self.goal_keys = goal_keys
        self._kept = self._with_future() if goal_probabilities[1] > 0 or goal_probabilities[2] > 0 else None

    def _with_future(self) -> NDArray[np.int64]:
        """The clips that have a later row."""
        clips = self.dataset.clip_indices
        if not hasattr(clips, "arrays"):
            return np.asarray([at for at, clip in enumerate(clips) if self._steps_left(*clip) >= 1], dtype=np.int64)
        episodes, starts = clips.arrays()
        left = (np.asarray(self.episode_lengths)[episodes] - 1 - self._current(starts)) // self.dataset.frameskip
        return np.flatnonzero(left >= 1)

    def _current(self, start: Any) -> Any:
        return start + (self.current_goal_offset - 1) * self.dataset.frameskip

    def _steps_left(self, episode: int, start: int) -> int:
        return int((self.episode_lengths[episode] - 1 - self._current(start)) // self.dataset.frameskip)

    @property
    def clip_indices(self) -> Sequence[tuple[int, int]]:
        """``(episode, first row)`` of the clips that have all goals that may be sampled."""
        every = self.dataset.clip_indices
        return every if self._kept is None else [every[index] for index in self._kept.tolist()]

    def __len__(self) -> int:
        return len(self.dataset.clip_indices) if self._kept is None else len(self._kept)

    @property
    def column_names(self) -> list[str]:
        """The columns of the dataset, without the goals."""
        return self.dataset.column_names

    @property
    def lengths(self) -> NDArray[Any]:
        """Rows of every episode."""
        return self.episode_lengths

    @property
    def offsets(self) -> NDArray[Any]:
        """First rows of the episodes."""
        return self.episode_offsets

    @property
    def episode_column_names(self) -> list[str]:
        """Names of values per episode."""
        return getattr(self.dataset, "episode_column_names", [])

    def get_episode_data(self, episodes_idx: NDArray[Any] | list[int] | None = None) -> dict[str, list[Any]]:
        """Values per episode."""
        return self.dataset.get_episode_data(episodes_idx) if hasattr(self.dataset, "get_episode_data") else {}

    def _renew(self) -> None:
        """Begins other random numbers in a worker of a ``DataLoader``, which has a copy of them in every epoch."""
        data = sys.modules.get("torch.utils.data")
        worker = None if data is None else data.get_worker_info()
        if worker is not None and worker.seed != self._worker_seed:
            self._worker_seed = worker.seed
            self.rng = np.random.default_rng([worker.seed, *([] if self.seed is None else [self.seed])])

    def _sample_goal_kind(self) -> str:
        kinds = np.cumsum(self.goal_probabilities)
        return KINDS[min(int(np.searchsorted(kinds, self.rng.random(), side="right")), len(KINDS) - 1)]

    def _sample_random_step(self) -> tuple[int, int]:
        rows = int(self._ends[-1]) if len(self._ends) else 0
        if rows == 0:
            return 0, 0
        row = int(self.rng.integers(rows))
        episode = int(np.searchsorted(self._ends, row, side="right"))
        return episode, row - int(self._ends[episode] - self.episode_lengths[episode])

    def _sample_geometric_future_step(self, ep_idx: int, local_start: int) -> tuple[int, int]:
        ahead = min(int(self.rng.geometric(max(1.0 - self.gamma, 1e-6))), self._steps_left(ep_idx, local_start))
        return ep_idx, self._current(local_start) + ahead * self.dataset.frameskip

    def _sample_uniform_future_step(self, ep_idx: int, local_start: int) -> tuple[int, int]:
        ahead = int(self.rng.integers(1, self._steps_left(ep_idx, local_start) + 1))
        return ep_idx, self._current(local_start) + ahead * self.dataset.frameskip

    def _get_clip_info(self, idx: int) -> tuple[int, int]:
        return self.dataset.clip_indices[idx if self._kept is None else int(self._kept[idx])]

    def _load_single_step(self, ep_idx: int, local_idx: int) -> dict[str, Any]:
        return self.dataset._load_slice(ep_idx, local_idx, local_idx + 1)

    def __getitem__(self, idx: int) -> dict[str, Any]:
        steps = dict(self.dataset[idx if self._kept is None else int(self._kept[idx])])
        if not self.goal_keys:
            return steps
        self._renew()
        episode, start = self._get_clip_info(idx)
        kind = self._sample_goal_kind()
        if kind == "random":
            goal = self._sample_random_step()
        elif kind == "geometric_future":
            goal = self._sample_geometric_future_step(episode, start)
        elif kind == "uniform_future":
            goal = self._sample_uniform_future_step(episode, start)
        else:
            goal = (episode, self._current(start))
        row = self._load_single_step(*goal)
        for source, target in self.goal_keys.items():
            if source in row and source in steps:
                value = row[source]
                steps[target] = value[None] if getattr(value, "ndim", 1) == 0 else value
        return steps

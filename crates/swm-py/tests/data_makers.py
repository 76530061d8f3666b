"""Episodes and files that the tests of datasets share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import stable_worldmodel_rs as swm

LENGTHS = (10, 7, 12)


def episode(length: int, seed: int, size: int = 32) -> dict[str, Any]:
    """One episode: images that videos keep well, and columns that tell episode and step."""
    rng = np.random.default_rng(seed)
    pixels = np.empty((length, size, size, 3), np.uint8)
    for step in range(length):
        pixels[step] = (10 * seed + 5 * step + np.array([0, 40, 90])) % 256
    return {
        "pixels": pixels,
        "action": rng.standard_normal((length, 2)).astype(np.float32),
        "state": np.stack([np.full(length, seed), np.arange(length), rng.random(length)], axis=1),
        "reward": rng.random(length),
        "done": np.arange(length) == length - 1,
        "count": np.arange(length, dtype=np.int64) + 1000 * seed,
        "env_name": [f"toy{seed}"] * length,
    }


def write(path: Path, format: str = "hdf5", lengths: tuple[int, ...] = LENGTHS, text: bool = True, **options: Any) -> Path:
    """A dataset of such episodes."""
    with swm.data.get_format(format).open_writer(path, **options) as writer:
        for seed, length in enumerate(lengths):
            columns = episode(length, seed)
            if not text:
                del columns["env_name"]
            writer.write_episode(columns)
    return path


def array(value: Any) -> np.ndarray[Any, Any]:
    """A tensor or array as an array."""
    return value.numpy() if hasattr(value, "numpy") else np.asarray(value)

"""Writes a file with h5py in several of the layouts that are met in the field, and prints a fingerprint per column."""

import json
import sys

import h5py
import hdf5plugin
import numpy as np

OFFSET, PRIME, MASK = 0xCBF29CE484222325, 0x100000001B3, (1 << 64) - 1


def fingerprint(array, lengths):
    """The fingerprint of `support.rs`: FNV-1a over the values' bits, episode by episode."""
    bits = {"f": {4: np.uint32, 8: np.uint64}}.get(array.dtype.kind, {}).get(array.dtype.itemsize)
    values = array.view(bits) if bits else array
    digest = OFFSET
    for value in values.ravel().tolist():
        digest = ((digest ^ (value & MASK)) * PRIME) & MASK
    return str(digest)


rng = np.random.default_rng(0)
lengths = np.array([3, 7, 5], np.int32)
steps = int(lengths.sum())
columns = {
    "pixels": (rng.integers(0, 256, (steps, 8, 6, 3), np.uint8), hdf5plugin.Blosc(cname="lz4", clevel=5, shuffle=1), (1, 8, 6, 3)),
    "goal": (rng.integers(0, 9, (steps, 8, 6, 3), np.uint8), hdf5plugin.Blosc(cname="zstd", clevel=3, shuffle=2), (4, 8, 6, 3)),
    "depth": (rng.integers(0, 9, (steps, 8, 6), np.uint8), {"compression": "gzip"}, (2, 8, 6)),
    "mask": (rng.integers(0, 2, (steps, 8), np.uint8), {"compression": "lzf"}, (3, 8)),
    "state": (rng.normal(size=(steps, 5)), {}, (1, 5)),
    "action": (rng.normal(size=(steps, 2)).astype(np.float32), {}, (1000, 2)),
    "step_idx": (np.concatenate([np.arange(n) for n in lengths]), {}, (1000,)),
    "terminated": (rng.integers(0, 2, steps).astype(bool), {}, (1000,)),
    "ep_idx": (np.repeat(np.arange(len(lengths), dtype=np.int32), lengths), {}, (1000,)),
}
with h5py.File(sys.argv[1], "w", libver="latest") as file:
    for name, (array, filters, chunks) in columns.items():
        maxshape = (None, *array.shape[1:])
        file.create_dataset(name, data=array, chunks=chunks, maxshape=maxshape, **filters)
    file.create_dataset("ep_len", data=lengths, maxshape=(None,))
    offsets = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64)
    file.create_dataset("ep_offset", data=offsets, maxshape=(None,))
print(
    json.dumps(
        {
            "episodes": len(lengths),
            "steps": steps,
            "hashes": {name: fingerprint(array, lengths) for name, (array, _, _) in columns.items()},
        }
    )
)

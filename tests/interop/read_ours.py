"""Opens a file as the reference's reader does (plain `r`, every root dataset but two is a column) and prints what it
sees as JSON."""

import json
import sys

import h5py
import hdf5plugin  # noqa: F401  (registers the Blosc filter)
import numpy as np

with h5py.File(sys.argv[1], "r") as file:
    lengths = file["ep_len"][:]
    offsets = file["ep_offset"][:]
    assert lengths.dtype == np.int32 and offsets.dtype == np.int64
    assert (offsets == np.concatenate([[0], np.cumsum(lengths)[:-1]])).all()
    columns = {name: data for name, data in file.items() if name not in ("ep_len", "ep_offset")}
    steps = int(lengths.sum())
    for name, data in columns.items():
        assert data.shape[0] == steps, f"{name} has {data.shape[0]} rows, not {steps}"
        data[:]
    last = (offsets + lengths - 1).tolist()
    actions = columns["action"][:]
    others = np.delete(actions, last, axis=0)
    assert np.isfinite(others).all()
    episode_of_row = np.repeat(np.arange(len(lengths)), lengths)
    assert (columns["ep_idx"][:] == episode_of_row).all()
    assert (columns["step_idx"][:][offsets] == 0).all()
    metadata = [json.loads(value) for value in file.attrs.values() if isinstance(value, str) and value.startswith("{")]
    print(
        json.dumps(
            {
                "episodes": len(lengths),
                "steps": steps,
                "columns": {
                    name: {"dtype": str(data.dtype), "shape": list(data.shape[1:])} for name, data in columns.items()
                },
                "last_actions_are_nan": bool(np.isnan(actions[last]).all()),
                "metadata": metadata[0],
            }
        )
    )

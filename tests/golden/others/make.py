"""Files of other programs, with types and orders that this project does not write: `python make.py` makes them anew.

h5py 3.16.0, NumPy 2.4, ml_dtypes 0.6.0, pyarrow. Values are a function of the row, which `values.json` has.
"""

import json
import shutil
from pathlib import Path

import h5py
import ml_dtypes
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

HERE = Path(__file__).parent
N = 12
ROWS = np.arange(N)
COLUMNS = {
    "u32": (4_000_000_000 + ROWS).astype(np.uint32),
    "u64": (2**53 + 1 + ROWS).astype(np.uint64),
    "f16": (ROWS[:, None] / 7 - 0.5 + np.arange(3)).astype(np.float16),
    "bf16": (ROWS[:, None] / 7 - 0.5 + np.arange(2)).astype(ml_dtypes.bfloat16),
    "i16": (ROWS - 6).astype(np.int16),
    "matrix": (ROWS[:, None, None] + np.arange(6).reshape(2, 3) / 10),
}
TOO_LARGE = 2**63 - 6 + ROWS.astype(np.uint64)


def write_values() -> None:
    values = {name: np.asarray(column, np.float64 if "f" in name or name == "matrix" else None).tolist() for name, column in COLUMNS.items()}
    (HERE / "values.json").write_text(json.dumps(values, indent=1) + "\n")


def write_hdf5() -> None:
    with h5py.File(HERE / "types.h5", "w") as file:
        file["ep_len"], file["ep_offset"] = np.array([5, 7], "i4"), np.array([0, 5], "i8")
        for name, column in COLUMNS.items():
            file[name] = column
            if name != "bf16":
                file[f"big_{name}"] = column.astype(column.dtype.newbyteorder(">"))
        for name in ("f16", "bf16", "u64"):
            shape = (4, *COLUMNS[name].shape[1:])
            file.create_dataset(f"gz_{name}", data=COLUMNS[name], chunks=shape, compression="gzip", shuffle=True)
        file.create_dataset("lzf_u64", data=COLUMNS["u64"], chunks=(4,), compression="lzf")
        file.create_dataset("lzf_bf16", data=COLUMNS["bf16"], chunks=(4, 2), compression="lzf")
        bf16 = h5py.h5t.IEEE_F16LE.copy()
        bf16.set_fields(15, 7, 8, 0, 7)
        bf16.set_ebias(127)
        space = h5py.h5s.create_simple((N, 2))
        made = h5py.h5d.create(file.id, b"float_bf16", bf16, space)
        made.write(h5py.h5s.ALL, h5py.h5s.ALL, np.asarray(COLUMNS["bf16"], np.float32))
        file["too_large"], file["complex"], file["long"] = TOO_LARGE, np.ones(N, complex), np.ones(N, np.longdouble)
        file.create_dataset("lzf_too_large", data=TOO_LARGE, chunks=(4,), compression="lzf")
        file["three_bytes"] = np.zeros(N, "V3")
        file.create_dataset("lzf_words", data=np.array([b"ab", b"cde"] * 6), chunks=(4,), compression="lzf")


def write_arrays() -> None:
    folder = HERE / "types.folder"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    np.savez(folder / "ep_len.npz", np.array([5, 7], ">i4"))
    np.savez_compressed(folder / "ep_offset.npz", np.array([0, 5], "<i8"))
    for name, column in COLUMNS.items():
        np.savez(folder / f"{name}.npz", column)
        if name != "bf16":
            big = column.astype(column.dtype.newbyteorder(">"))
            np.savez(folder / f"big_{name}.npz", big)
            np.savez_compressed(folder / f"gz_big_{name}.npz", np.asfortranarray(big))
        np.savez(folder / f"columns_{name}.npz", np.asfortranarray(column))
    np.savez(folder / "words.npz", np.array([f"wört{row}" for row in ROWS], ">U8"))
    np.savez(folder / "too_large.npz", TOO_LARGE)
    np.savez(folder / "complex.npz", np.ones(N, complex))
    np.savez(folder / "two_bytes.npz", np.zeros(N, "V2"))


def write_tables(name: str, lengths: list[int], files: list[list[int]], listed: list[int], extra: dict[str, pa.Array]) -> None:
    """A LeRobot dataset, v3.0: the episodes of each file, and the file of each episode by the list."""
    folder = HERE / name
    shutil.rmtree(folder, ignore_errors=True)
    for part in ("meta/episodes/chunk-000", "data/chunk-000"):
        (folder / part).mkdir(parents=True)
    starts = np.cumsum([0, *lengths])
    features = {"observation.state": ("float32", 2), "timestamp": ("float32", 1)}
    features |= {name: ("int64", 1) for name in ("frame_index", "episode_index", "index", "task_index")}
    described = {key: {"dtype": dtype, "shape": [width], "names": None} for key, (dtype, width) in features.items()}
    for key, array in extra.items():
        width = array.type.list_size if pa.types.is_fixed_size_list(array.type) else 1
        kind = array.type.value_type if width > 1 else array.type
        described[key] = {"dtype": {"halffloat": "float16", "float": "float32"}.get(str(kind), str(kind)), "shape": [width], "names": None}
    info = {
        "codebase_version": "v3.0", "fps": 10, "total_episodes": len(lengths), "total_frames": int(starts[-1]), "total_tasks": 1,
        "chunks_size": 1000, "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet", "video_path": None, "features": described,
    }  # fmt: skip
    (folder / "meta/info.json").write_text(json.dumps(info, indent=1) + "\n")
    pq.write_table(pa.table({"task_index": pa.array([0], pa.int64()), "task": ["push"]}), folder / "meta/tasks.parquet")
    columns = {
        "episode_index": range(len(lengths)), "length": lengths, "data/chunk_index": [0] * len(lengths), "data/file_index": listed,
        "dataset_from_index": starts[:-1], "dataset_to_index": starts[1:],
    }  # fmt: skip
    arrays = {key: pa.array(np.asarray(values, np.int64)) for key, values in columns.items()}
    pq.write_table(pa.table(arrays), folder / "meta/episodes/chunk-000/file-000.parquet")
    for at, episodes in enumerate(files):
        number = np.concatenate([np.full(lengths[episode], episode) for episode in episodes])
        frame = np.concatenate([np.arange(lengths[episode]) for episode in episodes])
        index = np.concatenate([starts[episode] + np.arange(lengths[episode]) for episode in episodes])
        state = pa.array(np.stack([number, frame], axis=1).astype(np.float32).tolist(), pa.list_(pa.float32(), 2))
        table = {
            "observation.state": state, "timestamp": pa.array((frame / 10).astype(np.float32)), "frame_index": pa.array(frame),
            "episode_index": pa.array(number), "index": pa.array(index), "task_index": pa.array(np.zeros_like(number)),
        } | extra  # fmt: skip
        pq.write_table(pa.table(table), folder / f"data/chunk-000/file-{at:03d}.parquet")


def write_lerobot() -> None:
    # As LeRobot's converter from v2.1 once left the list: the episode at the border of two files has the number of the file before.
    write_tables("stale.lerobot", [8, 6, 7], [[0], [1, 2]], [0, 0, 1], {})
    nan = pa.array([None if row == 4 else float(row) for row in ROWS], pa.float32())
    gaps = [None if row == 4 else [None, 1.0] if row == 6 else [float(row), -float(row)] for row in ROWS]
    extra = {
        "u32": pa.array(COLUMNS["u32"]), "u64": pa.array(COLUMNS["u64"]), "i16": pa.array(COLUMNS["i16"]),
        "f16": pa.array(list(COLUMNS["f16"]), pa.list_(pa.float16(), 3)), "too_large": pa.array(TOO_LARGE), "reward": nan,
        "action": pa.array(gaps, pa.list_(pa.float32(), 2)), "holes": pa.array([None if row == 4 else int(row) for row in ROWS], pa.int64()),
        "half": pa.array([None if row == 4 else np.float16(row) for row in ROWS], pa.float16()),
        "date": pa.array([b"12345"] * N, pa.binary(5)), "events": pa.array([{"text": "a", "at": 1}] * N),
    }  # fmt: skip
    write_tables("types.lerobot", [5, 7], [[0, 1]], [0, 0], extra)


if __name__ == "__main__":
    write_values()
    write_hdf5()
    write_arrays()
    write_lerobot()

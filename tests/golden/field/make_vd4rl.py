"""Files in the layout of V-D4RL's HDF5 (1ceaf220, `npz_to_hdf5.py` and `split_hdf5_shards.py`): `python make_vd4rl.py` makes them anew.

h5py 3.16, NumPy 2.5. Three episodes of random values, cut into two files by rows, amid the second episode, as `numpy.array_split` does. What
`vd4rl_toy.expected.json` has follows the rule of dm_env: the action and the reward of row t + 1 are those taken in row t.
"""

import hashlib
import json
from pathlib import Path

import h5py
import numpy as np

HERE = Path(__file__).parent
OUT = HERE / "vd4rl_toy"
LENGTH = 5
FILES = ("2.hdf5", "10.hdf5")
# The second episode is in both files.
PARTS = ((0, 5), (5, 8), (8, 10), (10, 15))
SIDE = 8


def episode(number: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(100 + number)
    step_type = np.ones(LENGTH)
    step_type[0], step_type[-1] = 0, 2
    arrays = {
        "action": rng.normal(size=(LENGTH, 2)).astype(np.float32),
        "discount": np.ones(LENGTH, np.float32),
        "observation": rng.integers(0, 256, (1, 3, 1, 1), np.uint8) + np.arange(LENGTH * SIDE**2, dtype=np.uint8).reshape(LENGTH, 1, SIDE, SIDE),
        "reward": rng.normal(size=LENGTH).astype(np.float32),
        "step_type": step_type,
    }
    arrays["action"][0], arrays["reward"][0] = 0, 0
    if number == 2:
        arrays["discount"][-1] = 0
    return arrays


def column(values: np.ndarray, skipped: int) -> dict:
    parts = [np.asarray(values[first + skipped : last], np.float64).reshape(last - first - skipped, -1) for first, last in PARTS]
    return {"rows": [len(part) for part in parts], "first": parts[0][0].tolist(), "last": parts[-1][-1].tolist(), "sum": sum(part.sum() for part in parts)}


def main() -> None:
    OUT.mkdir(exist_ok=True)
    episodes = [episode(number) for number in range(3)]
    rows = {name: np.concatenate([arrays[name] for arrays in episodes]) for name in episodes[0]}
    for at, name in enumerate(FILES):
        with h5py.File(OUT / name, "w") as file:
            for key, values in rows.items():
                file.create_dataset(key, data=np.array_split(values, len(FILES))[at], compression="gzip")
    columns = {name: column(rows[name], 1) for name in ("action", "reward")} | {name: column(rows[name], 0) for name in ("discount", "step_type")}
    image = rows["observation"][PARTS[1][0] + 2].transpose(1, 2, 0)
    images = {"observation": {"episode": 1, "row": 2, "shape": image.shape, "sha256_of_u8_rgb": hashlib.sha256(image.tobytes()).hexdigest()}}
    expected = {"columns": columns, "images": images, "rows_per_episode": [last - first for first, last in PARTS]}
    (HERE / "vd4rl_toy.expected.json").write_text(json.dumps(expected, indent=1) + "\n")


if __name__ == "__main__":
    main()

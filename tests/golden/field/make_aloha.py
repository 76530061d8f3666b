"""Files in the layout of ALOHA (act 742c753c, `record_sim_episodes.py`), two cameras of 8 x 8: `python make_aloha.py` makes them anew.

h5py 3.16, NumPy 2.5. Three episodes of random values; their order is that of the numbers in their names.
"""

import hashlib
import json
from pathlib import Path

import h5py
import numpy as np

HERE = Path(__file__).parent
OUT = HERE / "aloha_toy"
LENGTHS = {0: 4, 2: 3, 10: 5}
CAMERAS = ("angle", "top")


def episode(number: int, length: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(200 + number)
    arrays = {name: rng.normal(size=(length, 14)).astype(np.float32) for name in ("action", "observations/qpos", "observations/qvel")}
    ramp = np.arange(length * 64, dtype=np.uint8).reshape(length, 8, 8, 1)
    return arrays | {f"observations/images/{name}": rng.integers(0, 256, (1, 1, 1, 3), np.uint8) + ramp for name in CAMERAS}


def main() -> None:
    OUT.mkdir(exist_ok=True)
    episodes = [episode(number, length) for number, length in LENGTHS.items()]
    for number, arrays in zip(LENGTHS, episodes, strict=True):
        with h5py.File(OUT / f"episode_{number}.hdf5", "w") as file:
            file.attrs["sim"] = True
            for name, values in arrays.items():
                chunks = (1, *values.shape[1:]) if values.dtype == np.uint8 else None
                file.create_dataset(name, data=values, chunks=chunks)
    columns = {}
    for name in ("action", "observations/qpos", "observations/qvel"):
        parts = [np.asarray(arrays[name], np.float64) for arrays in episodes]
        total = float(sum(part.sum() for part in parts))
        columns[name] = {"rows": [len(part) for part in parts], "first": parts[0][0].tolist(), "last": parts[-1][-1].tolist(), "sum": total}
    image = episodes[2]["observations/images/top"][1]
    images = {"top": {"episode": 2, "row": 1, "shape": image.shape, "sha256_of_u8_rgb": hashlib.sha256(image.tobytes()).hexdigest()}}
    expected = {"columns": columns, "images": images, "rows_per_episode": list(LENGTHS.values())}
    (HERE / "aloha_toy.expected.json").write_text(json.dumps(expected, indent=1) + "\n")


if __name__ == "__main__":
    main()

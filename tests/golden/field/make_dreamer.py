"""A folder of episodes as DreamerV2 saves them (V-D4RL 425206b, `save_episode`): `python make_dreamer.py` makes it anew.

NumPy 2.4. What `dreamer_toy.expected.json` has follows the rule of Dreamer's driver: the action and the reward of row t + 1 are those taken in row t.
"""

import hashlib
import json
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
OUT = HERE / "dreamer_toy"
LENGTHS = (6, 4, 7)


def episode(number: int, length: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(number)
    arrays = {
        "image": rng.integers(0, 256, (1, 1, 1, 3), np.uint8) + np.arange(length * 64, dtype=np.uint8).reshape(length, 8, 8, 1),
        "action": rng.normal(size=(length, 2)).astype(np.float32),
        "reward": rng.normal(size=length).astype(np.float32),
        "discount": np.ones(length, np.float32),
        "is_first": np.arange(length) == 0,
        "is_last": np.arange(length) == length - 1,
        "is_terminal": np.zeros(length, bool),
        "log_name": np.array("toy"),
    }
    arrays["action"][0], arrays["reward"][0] = 0, 0
    if number == 1:
        arrays["is_terminal"][-1], arrays["discount"][-1] = True, 0
    return arrays


def column(parts: list[np.ndarray]) -> dict:
    flat = [np.asarray(part, np.float64).reshape(len(part), -1) for part in parts]
    return {"rows": [len(part) for part in parts], "first": flat[0][0].tolist(), "last": flat[-1][-1].tolist(), "sum": sum(part.sum() for part in flat)}


def main() -> None:
    OUT.mkdir(exist_ok=True)
    episodes = [episode(number, length) for number, length in enumerate(LENGTHS)]
    for number, arrays in enumerate(episodes):
        name = f"20211105T12300{number}-{hashlib.md5(bytes([number])).hexdigest()}-{len(arrays['action']) - 1}.npz"
        np.savez_compressed(OUT / name, **arrays)
    columns = {name: column([arrays[name][1:] for arrays in episodes]) for name in ("action", "reward")}
    columns |= {name: column([arrays[name] for arrays in episodes]) for name in ("discount", "is_first", "is_terminal")}
    image = episodes[1]["image"][2]
    images = {"image": {"episode": 1, "row": 2, "shape": image.shape, "sha256_of_u8_rgb": hashlib.sha256(image.tobytes()).hexdigest()}}
    expected = {"columns": columns, "images": images, "rows_per_episode": LENGTHS}
    (HERE / "dreamer_toy.expected.json").write_text(json.dumps(expected, indent=1) + "\n")


if __name__ == "__main__":
    main()

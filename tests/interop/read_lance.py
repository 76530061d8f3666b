"""Opens one of our Lance tables with pylance, and prints what it sees as JSON: lengths of episodes, the sum of every column
of values, the first of every column of texts, the mean of every column of images."""

import io
import json
import sys
from pathlib import Path

import av
import lance
import numpy as np
import pyarrow as pa
from PIL import Image

path = Path(sys.argv[1])
dataset = lance.dataset(str(path))
dataset.validate()
table = dataset.to_table()
episodes = table["episode_idx"].to_numpy()
lengths = np.bincount(episodes).tolist()
assert table["step_idx"].to_pylist() == [row for length in lengths for row in range(length)]
assert (np.diff(episodes) >= 0).all()
seen = {"lengths": lengths, "sums": {}, "texts": {}, "means": {}}
for field in table.schema:
    values = table[field.name]
    if pa.types.is_fixed_size_list(field.type):
        flat = values.combine_chunks().flatten().to_numpy(zero_copy_only=False).astype(float)
        seen["sums"][field.name] = float(flat[np.isfinite(flat)].sum())
    elif pa.types.is_string(field.type):
        seen["texts"][field.name] = values[0].as_py()
    elif pa.types.is_binary(field.type):
        frames = [np.array(Image.open(io.BytesIO(file.as_py()))) for file in values]
        seen["means"][field.name] = float(np.mean(frames))
# Rows at random, as a loader asks for them.
some = [len(episodes) - 1, 0, len(episodes) // 2]
assert dataset.take(some, columns=["episode_idx"])["episode_idx"].to_pylist() == episodes[some].tolist()

videos = path.with_name(path.stem + "_videos" + path.suffix)
if videos.exists():
    videos = lance.dataset(str(videos))
    keys = videos.to_table(columns=["episode_idx", "video_key"]).to_pylist()
    frames = {}
    for row, blob in enumerate(videos.take_blobs("video_bytes", indices=list(range(len(keys))))):
        shown = [frame.to_ndarray(format="rgb24") for frame in av.open(io.BytesIO(blob.read())).decode(video=0)]
        # A video of one frame shows it twice.
        shown = shown[: lengths[keys[row]["episode_idx"]]]
        assert len(shown) == lengths[keys[row]["episode_idx"]], keys[row]
        frames.setdefault(keys[row]["video_key"], []).extend(shown)
    seen["means"] = {key: float(np.mean(shown)) for key, shown in frames.items()}
print(json.dumps(seen))

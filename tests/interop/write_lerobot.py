"""Writes a LeRobot dataset of version 3.0 as LeRobot itself does, with pyarrow and PyAV: two episodes in one table and one video,
the video in AV1 by SVT-AV1 at LeRobot's own settings. Prints a digest per numeric column, and the mean of every frame in the
planes that dav1d decodes."""

import json
import sys
from pathlib import Path

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from fingerprint import fingerprint

FPS, HEIGHT, WIDTH, CAMERA = 10, 64, 96, "observation.images.top"
root = Path(sys.argv[1])
rng = np.random.default_rng(0)
lengths = [7, 12]
total = sum(lengths)
steps = np.concatenate([np.arange(n) for n in lengths])
columns = {
    "observation.state": rng.normal(size=(total, 3)).astype(np.float32),
    "action": rng.normal(size=(total, 2)).astype(np.float32),
    "timestamp": (steps / FPS).astype(np.float32),
    "frame_index": steps.astype(np.int64),
    "episode_index": np.repeat(np.arange(len(lengths)), lengths).astype(np.int64),
    "index": np.arange(total, dtype=np.int64),
    "task_index": np.zeros(total, np.int64),
}


def frame(step):
    """A square that moves over a gradient."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    image = np.stack([2 * x, 3 * y, 0 * x + 60], axis=-1).astype(np.uint8)
    image[20:40, 3 * step : 3 * step + 20] = (220, 40, 40)
    return image


def rgb(image):
    """A decoded image as RGB, exactly: FFmpeg's own conversion rounds down, and is a level darker."""
    planes = image.to_ndarray(format="yuv420p").astype(float)
    luma, chroma = planes[:HEIGHT], planes[HEIGHT:].reshape(2, HEIGHT // 2, WIDTH // 2)
    u, v = (plane.repeat(2, 0).repeat(2, 1) - 128 for plane in chroma)
    y, scale = (luma - 16) * 255 / 219, 255 / 224
    red, blue = y + 1.402 * v * scale, y + 1.772 * u * scale
    green = (y - 0.299 * red - 0.114 * blue) / 0.587
    return np.clip(np.stack([red, green, blue], axis=-1).round(), 0, 255)


def table(path, content):
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(content), root / path)


video = f"videos/{CAMERA}/chunk-000/file-000.mp4"
(root / video).parent.mkdir(parents=True)
with av.open(str(root / video), "w") as output:
    stream = output.add_stream("libsvtav1", rate=FPS, options={"g": "2", "crf": "30"})
    stream.height, stream.width, stream.pix_fmt = HEIGHT, WIDTH, "yuv420p"
    for step in range(total):
        output.mux(stream.encode(av.VideoFrame.from_ndarray(frame(step), format="rgb24")))
    output.mux(stream.encode())
with av.open(str(root / video)) as written:
    assert written.streams.video[0].codec_context.name in ("libdav1d", "av1", "libaom-av1")
    means = [rgb(shown).mean() for shown in written.decode(video=0)]
assert len(means) == total

table("data/chunk-000/file-000.parquet", {name: list(values) for name, values in columns.items()})
table("meta/tasks.parquet", {"task_index": [0], "task": ["push"]})
ends = np.cumsum(lengths)
starts = ends - lengths
zeros = [0] * len(lengths)
table(
    "meta/episodes/chunk-000/file-000.parquet",
    {
        "episode_index": range(len(lengths)),
        "tasks": [["push"]] * len(lengths),
        "length": lengths,
        "data/chunk_index": zeros,
        "data/file_index": zeros,
        "dataset_from_index": starts,
        "dataset_to_index": ends,
        f"videos/{CAMERA}/chunk_index": zeros,
        f"videos/{CAMERA}/file_index": zeros,
        f"videos/{CAMERA}/from_timestamp": starts / FPS,
        f"videos/{CAMERA}/to_timestamp": ends / FPS,
    },
)
features = {
    name: {"dtype": str(values.dtype), "shape": list(values.shape[1:]) or [1], "names": None} for name, values in columns.items()
}
features[CAMERA] = {"dtype": "video", "shape": [HEIGHT, WIDTH, 3], "names": ["height", "width", "channels"]}
info = {
    "codebase_version": "v3.0",
    "robot_type": "test",
    "total_episodes": len(lengths),
    "total_frames": total,
    "total_tasks": 1,
    "chunks_size": 1000,
    "fps": FPS,
    "splits": {"train": f"0:{len(lengths)}"},
    "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    "features": features,
}
(root / "meta/info.json").write_text(json.dumps(info))
hashes = {"proprio": fingerprint(columns["observation.state"]), "action": fingerprint(columns["action"])}
print(json.dumps({"episodes": len(lengths), "steps": total, "hashes": hashes, "frame_means": means}))

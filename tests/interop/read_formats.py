"""Opens one of our folders, videos, logs or LeRobot datasets with the programs that others use, and prints what it sees as JSON: a digest
per numeric column, the mean of every frame per column of images, and of logs a digest of the images too."""

import io
import json
import sys
from pathlib import Path

import av
import mcap.reader
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from fingerprint import fingerprint
from PIL import Image


TYPES = {"bool": bool, "u8": np.uint8, "i32": np.int32, "i64": np.int64, "f32": np.float32, "f64": np.float64}


def folder(path):
    """As the reference's readers do: every `.npz` and every subfolder but those of the index is a column."""
    lengths = np.load(path / "ep_len.npz")["arr_0"]
    offsets = np.load(path / "ep_offset.npz")["arr_0"]
    assert lengths.dtype == np.int32 and offsets.dtype == np.int64
    assert (offsets == np.concatenate([[0], np.cumsum(lengths)[:-1]])).all()
    columns = {}
    for entry in path.iterdir():
        if entry.stem in ("ep_len", "ep_offset"):
            continue
        if entry.is_dir():
            columns[entry.name] = [frame for e, n in enumerate(lengths) for frame in frames(entry, e, n)]
        else:
            columns[entry.stem] = np.load(entry)["arr_0"]
            assert len(columns[entry.stem]) == lengths.sum(), entry
    return lengths, columns


def frames(column, episode, count):
    video = column / f"ep_{episode}.mp4"
    if video.exists():
        shown = [frame.to_ndarray(format="rgb24") for frame in av.open(str(video)).decode(video=0)]
        assert len(shown) == count, (video, len(shown), count)
        return shown
    return [np.array(Image.open(column / f"ep_{episode}_step_{step}.jpeg")) for step in range(count)]


def lerobot(path):
    """As LeRobot 3.0 does: by the list of episodes, every table that there is, videos by their times; under our names."""
    info = json.loads((path / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    episodes = pa.concat_tables(pq.read_table(file) for file in sorted(path.glob("meta/episodes/*/*.parquet"))).to_pylist()
    tables = pa.concat_tables(pq.read_table(file) for file in sorted(path.glob("data/*/*.parquet")))
    lengths = np.array([episode["length"] for episode in episodes])
    assert info["total_episodes"] == len(lengths) and info["total_frames"] == len(tables) == lengths.sum()
    assert tables["index"].to_pylist() == list(range(len(tables)))
    assert [t["task"] for t in pq.read_table(path / "meta/tasks.parquet").to_pylist()] == [episodes[0]["tasks"][0]]
    statistics = json.loads((path / "meta/stats.json").read_text())
    names = {"observation.state": "proprio", "episode_index": "ep_idx"}
    columns = {}
    for name, feature in info["features"].items():
        ours = names.get(name, name.removeprefix("observation.images."))
        if feature["dtype"] == "video":
            columns[ours] = [frame for episode in episodes for frame in video(path, info, name, episode)]
            assert np.shape(statistics[name]["mean"]) == (3, 1, 1)
        elif name in ("timestamp", "frame_index", "index", "task_index"):
            continue
        else:
            values = np.array(tables[name].to_pylist())
            columns[ours] = values.astype(np.int32 if ours == "ep_idx" else feature["dtype"].replace("u8", "uint8"))
            finite = values.astype(float)[np.isfinite(values.astype(float)).reshape(len(values), -1).all(axis=1)]
            if name in statistics and len(finite) == len(values):
                assert np.allclose(statistics[name]["mean"], np.atleast_1d(finite.mean(axis=0)), rtol=1e-6), name
    return lengths, columns


def video(path, info, camera, episode):
    number = {part: episode[f"videos/{camera}/{part}_index"] for part in ("chunk", "file")}
    place = info["video_path"].format(video_key=camera, chunk_index=number["chunk"], file_index=number["file"])
    first, last = (episode[f"videos/{camera}/{end}_timestamp"] for end in ("from", "to"))
    shown = [f.to_ndarray(format="rgb24") for f in av.open(str(path / place)).decode(video=0) if first <= f.time < last]
    assert len(shown) == episode["length"], (place, len(shown))
    return shown


def log(path):
    """By the summary and the index, as a viewer does; then record by record."""
    with open(path, "rb") as file:
        reader = mcap.reader.make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        records = {}
        for record in reader.iter_metadata():
            records.setdefault(record.name, []).append(record.metadata)
        fields = {field["name"]: field for field in json.loads(records["swm.dataset"][0]["columns"])}
        lengths = np.array([int(episode["rows"]) for episode in records["swm.episode"]])
        rows, images = [], {}
        for schema, channel, message in reader.iter_messages():
            if channel.topic == "/step":
                assert (schema.name, channel.message_encoding) == ("swm.Step", "json")
                rows.append(json.loads(message.data))
            else:
                assert (schema.name, schema.encoding) == ("foxglove.CompressedImage", "protobuf")
                images.setdefault(channel.topic[1:], {})[len(rows)] = np.array(Image.open(io.BytesIO(png(message.data))))
        counts = summary.statistics.channel_message_counts
        assert sum(counts.values()) == summary.statistics.message_count == len(rows) + sum(map(len, images.values()))
    columns = {}
    for name, field in fields.items():
        if name in images:
            shown, last = [], None
            for row in range(len(rows)):
                last = images[name].get(row, last)
                shown.append(last)
            columns[name] = shown
        else:
            values = [[np.nan if v is None else v for v in np.atleast_1d(np.array(row[name], dtype=object))] for row in rows]
            columns[name] = np.array(values).astype(TYPES[field["dtype"]])
    return lengths, columns


def png(message):
    """The field `data`, number 2, of a message in Protocol Buffers."""
    at = 0

    def varint():
        nonlocal at
        value = shift = 0
        while True:
            byte = message[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(message):
        tag, length = varint(), varint()
        if tag >> 3 == 2:
            return message[at : at + length]
        at += length
    raise ValueError("no image")


path = Path(sys.argv[1])
read = log if path.is_file() else lerobot if (path / "meta/info.json").exists() else folder
lengths, columns = read(path)
seen = {"episodes": len(lengths), "steps": int(lengths.sum()), "hashes": {}, "frame_means": {}}
for name, values in columns.items():
    if isinstance(values, list):
        seen["frame_means"][name] = [float(frame.mean()) for frame in values]
        if path.is_file():
            seen["hashes"][name] = fingerprint(np.stack(values))
    else:
        seen["hashes"][name] = fingerprint(np.ascontiguousarray(values))
print(json.dumps(seen))

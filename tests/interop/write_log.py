"""Writes an MCAP file in the layout of our format with the Python package, its chunks compressed as the second argument
says (NONE, LZ4, ZSTD), and prints a digest per column."""

import io
import json
import sys

import numpy as np
from fingerprint import fingerprint
from mcap.writer import CompressionType, Writer
from PIL import Image

rng = np.random.default_rng(0)
lengths = [3, 5]
steps = sum(lengths)
columns = {
    "pixels": rng.integers(0, 256, (steps, 8, 6, 3), np.uint8),
    "state": rng.normal(size=(steps, 5)),
    "action": rng.normal(size=(steps, 2)).astype(np.float32),
    "step_idx": np.concatenate([np.arange(n) for n in lengths]),
    "terminated": rng.integers(0, 2, steps).astype(bool),
}
columns["action"][2] = np.nan
TYPES = {"uint8": "u8", "float64": "f64", "float32": "f32", "int64": "i64", "bool": "bool"}
ROW_NS = 100_000_000


def varint(value):
    out = b""
    while value >= 128:
        out += bytes([value & 127 | 128])
        value >>= 7
    return out + bytes([value])


def compressed(array):
    file = io.BytesIO()
    Image.fromarray(array).save(file, "png")
    data = file.getvalue()
    return b"\x12" + varint(len(data)) + data + b"\x1a\x03png"


def plain(value):
    return None if isinstance(value, float) and np.isnan(value) else value


with open(sys.argv[1], "wb") as file:
    writer = Writer(file, chunk_size=2000, compression=CompressionType[sys.argv[2]])
    writer.start()
    step = writer.register_schema("swm.Step", "jsonschema", b"{}")
    image = writer.register_schema("foxglove.CompressedImage", "protobuf", b"")
    step = writer.register_channel("/step", "json", step)
    image = writer.register_channel("/pixels", "protobuf", image)
    fields = [
        {"name": name, "dtype": TYPES[str(data.dtype)], "shape": list(data.shape[1:]), "kind": "step"}
        for name, data in columns.items()
    ]
    writer.add_metadata("swm.dataset", {"version": "1", "columns": json.dumps(fields), "row_ns": str(ROW_NS)})
    row = 0
    for episode, length in enumerate(lengths):
        for _ in range(length):
            time = row * ROW_NS
            writer.add_message(image, time, compressed(columns["pixels"][row]), time)
            values = {name: data[row].tolist() for name, data in columns.items() if name != "pixels"}
            values = {n: [plain(x) for x in v] if isinstance(v, list) else plain(v) for n, v in values.items()}
            writer.add_message(step, time, json.dumps(values).encode(), time)
            row += 1
        # The commit stands behind the messages: end their chunk.
        writer._Writer__finalize_chunk()
        writer.add_metadata("swm.episode", {"index": str(episode), "first_row": str(row - length), "rows": str(length)})
    writer.finish()
hashes = {name: fingerprint(data) for name, data in columns.items()}
print(json.dumps({"episodes": len(lengths), "steps": steps, "hashes": hashes}))

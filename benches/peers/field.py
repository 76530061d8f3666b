#!/usr/bin/env python3
"""Loads random clips of other programs' files here and by these programs' own dataset classes in torch's DataLoader, side by side.

    python3 benches/peers/field.py --diffusion-policy FOLDER [--rounds 3] [--json result.json] [--check]

The interpreter needs this project's wheel, torch, h5py, zarr 2 with numba (for the sampler of diffusion_policy), robomimic 0.3
(`pip install --no-deps robomimic`) and pylance; FOLDER is a checkout of diffusion_policy 5ba07ac. Files are made here, as these
programs lay them out. Both sides give tensors of torch in batches of 64 shuffled clips, in one process and on one thread; what is
compared is clips per second of CPU time, in the best round, which other programs disturbed least. Rows of S3 read a Lance table by
way of a server on this machine, in another process, with an empty cache; next to it is the same table on the disk.
"""

import argparse
import http.server
import io
import json
import multiprocessing
import os
import sys
import tempfile
import time
import urllib.parse
from pathlib import Path

import h5py
import numpy as np
import stable_worldmodel_rs as swm
import torch

BATCH = 64
# Name, least ratio.
CASES = {
    "robomimic, HDF5": 3,
    "robomimic, HDF5, gzip": None,
    "robomimic, HDF5, gzip, decoded once": 3,
    "diffusion_policy, Zarr": 3,
    "diffusion_policy, Zarr, as floats": None,
    "Lance by S3": 0.7,
}


def main():
    options = arguments()
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        sides = {name: case(Path(folder)) for name, case in MAKERS.items() if options.only in name}
        best = {}
        for _ in range(options.rounds):
            for name, (here, there) in sides.items():
                for side, make in (("here", here), ("there", there)):
                    key = (name, side)
                    best[key] = max(best.get(key, 0.0), rate(make, options.seconds))
    rows = []
    for name in sides:
        here, there = best[name, "here"], best[name, "there"]
        rows.append({"case": name, "here": here, "there": there, "ratio": here / there, "wanted": CASES[name]})
    print(report(rows))
    if options.json:
        options.json.write_text(json.dumps({"cases": rows, "load": os.getloadavg()}, indent=2) + "\n")
    sys.exit(int(options.check and any(row["ratio"] < (row["wanted"] or 0) for row in rows)))


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--diffusion-policy", type=Path, help="a checkout; without it, its row is left out")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=2.0, help="of CPU time, per side and round")
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose name holds this")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--check", action="store_true", help="exit with 1 where a ratio is missed")
    options = parser.parse_args()
    if options.diffusion_policy:
        sys.path.insert(0, str(options.diffusion_policy))
    else:
        for name in [name for name in MAKERS if name.startswith("diffusion_policy")]:
            MAKERS.pop(name)
    return options


def rate(make, seconds):
    """Clips per second of CPU time. What is opened and decoded once, before the first batch, does not count."""
    batches = make()
    iterator = iter(batches)
    next(iterator)
    clips, start = 0, time.process_time()
    while (used := time.process_time() - start) < seconds:
        batch = next(iterator, None)
        if batch is None:
            iterator = iter(batches)
            continue
        clips += count(batch)
    return clips / used


def count(batch):
    while isinstance(batch, dict):
        batch = next(iter(batch.values()))
    return len(batch)


def image(rng, side):
    """Smooth colors with a block in them, which compress about as well as images of a simulator."""
    ramp = np.linspace(rng.uniform(0, 120), rng.uniform(130, 255), side)
    pixels = np.stack([ramp[:, None] + ramp[None, :] * scale for scale in (0.3, 0.5, 0.2)], -1) / 1.5
    y, x = rng.integers(0, side - 16, 2)
    pixels[y : y + 16, x : x + 16] = rng.uniform(0, 255, 3)
    return np.clip(pixels + rng.normal(0, 1, pixels.shape), 0, 255).astype(np.uint8)


def images(rng, side, count):
    """So many, out of a hundred: making them all takes longer than the measurement."""
    some = np.stack([image(rng, side) for _ in range(100)])
    return some[rng.integers(0, len(some), count)]


def robomimic(folder, compression, cache=None):
    path = folder / f"image-{compression}-{cache}.hdf5"
    rng = np.random.default_rng(0)
    seen = images(rng, 84, 4000)
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_name": "Lift", "env_type": 1, "env_kwargs": {"control_freq": 20}})
        for episode in range(40):
            demo = data.create_group(f"demo_{episode}")
            demo.attrs["num_samples"] = 100
            demo.create_dataset("actions", data=rng.uniform(-1, 1, (100, 7)))
            demo.create_dataset("rewards", data=np.zeros(100))
            demo.create_dataset("dones", data=np.arange(100) == 99)
            demo.create_dataset("obs/robot0_eef_pos", data=rng.uniform(-1, 1, (100, 3)))
            pixels = seen[episode * 100 : (episode + 1) * 100]
            demo.create_dataset("obs/agentview_image", data=pixels, compression=compression)
        data.attrs["total"] = 4000

    def there():
        import robomimic.utils.obs_utils as obs_utils
        from robomimic.utils.dataset import SequenceDataset

        modalities = {"low_dim": ["robot0_eef_pos"], "rgb": ["agentview_image"]}
        obs_utils.initialize_obs_utils_with_obs_specs([{"obs": modalities}])
        dataset = SequenceDataset(
            str(path), ("agentview_image", "robot0_eef_pos"), ("actions",), seq_length=10, hdf5_cache_mode="low_dim", load_next_obs=False
        )
        return torch.utils.data.DataLoader(dataset, BATCH, shuffle=True)

    def here():
        keys = ["pixels", "obs.robot0_eef_pos", "action"]
        return swm.data.Loader(str(path), BATCH, num_steps=10, keys=keys, threads=1, cache=cache)

    return here, there


def diffusion_policy(folder, transform=None):
    from diffusion_policy.common.replay_buffer import ReplayBuffer
    from diffusion_policy.dataset.pusht_image_dataset import PushTImageDataset

    path = folder / f"pusht-{transform is not None}.zarr"
    rng = np.random.default_rng(0)
    buffer = ReplayBuffer.create_from_path(str(path), mode="w")
    for seen in np.split(images(rng, 96, 3600), 30):
        state, action = (rng.uniform(0, 512, (120, dim)).astype(np.float32) for dim in (5, 2))
        buffer.add_episode({"img": seen.astype(np.float32), "state": state, "action": action}, compressors="disk")

    # Its class decodes the whole file into memory; the cache of the loader here, once, into a file beside it.
    def there():
        dataset = PushTImageDataset(str(path), horizon=16, pad_before=1, pad_after=7)
        return torch.utils.data.DataLoader(dataset, BATCH, shuffle=True)

    def here():
        keys = ["pixels", "state", "action"]
        options = {"num_steps": 16, "keys": keys, "threads": 1, "cache": "decoded", "transform": transform}
        return swm.data.Loader(str(path), BATCH, **options)

    return here, there


def floats(batch):
    """Images as that class gives them; the loader here gives bytes."""
    return {**batch, "pixels": batch["pixels"].float().div_(255)}


def lance(folder):
    import lance as pylance
    import pyarrow as pa
    from PIL import Image

    root = folder / "s3"
    path = root / "bucket" / "pusht.lance"
    path.parent.mkdir(parents=True)
    rng = np.random.default_rng(0)
    files, rows = [], 4000
    for pixels in images(rng, 96, rows):
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "JPEG", quality=95)
        files.append(file.getvalue())
    lists = {"state": 7, "action": 2}
    columns = {"episode_idx": pa.array(np.arange(rows) // 100, pa.int32()), "step_idx": pa.array(np.arange(rows) % 100, pa.int32())}
    for name, dim in lists.items():
        values = pa.array(rng.uniform(-1, 1, rows * dim).astype(np.float32))
        columns[name] = pa.FixedSizeListArray.from_arrays(values, dim)
    columns["pixels"] = pa.array(files, pa.binary())
    pylance.write_dataset(pa.table(columns), str(path))
    multiprocessing.get_context("spawn").Process(target=serve, args=(root, folder / "port"), daemon=True).start()
    while not (folder / "port").exists():
        time.sleep(0.05)
    os.environ |= {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{(folder / 'port').read_text()}",
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
    }
    turns = iter(range(1 << 30))

    def loader(name):
        return swm.data.Loader(name, BATCH, num_steps=4, keys=["pixels", "state", "action"], threads=1)

    def here():
        os.environ["SWM_CACHE"] = str(folder / f"cache-{next(turns)}")
        return loader("s3://bucket/pusht.lance")

    return here, lambda: loader(str(path))


def serve(root, port):
    """Lists and ranges, as S3 gives them."""

    class Handler(http.server.BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_):
            pass

        def do_HEAD(self):
            self.answer(False)

        def do_GET(self):
            self.answer(True)

        def answer(self, has_body):
            url = urllib.parse.urlsplit(self.path)
            query = urllib.parse.parse_qs(url.query)
            path = root / urllib.parse.unquote(url.path).strip("/")
            if "list-type" in query:
                prefix = query.get("prefix", [""])[0]
                found = sorted(file for file in path.rglob("*") if file.is_file())
                keys = [(str(file.relative_to(path)), file) for file in found]
                items = "".join(
                    f"<Contents><Key>{key}</Key><LastModified>2026-01-01T00:00:00.000Z</LastModified>"
                    f'<ETag>"{file.stat().st_size}"</ETag><Size>{file.stat().st_size}</Size></Contents>'
                    for key, file in keys
                    if key.startswith(prefix)
                )
                body = f'<?xml version="1.0"?><ListBucketResult><IsTruncated>false</IsTruncated>{items}</ListBucketResult>'.encode()
                return self.give(200, body, has_body)
            if not path.is_file():
                return self.give(404, b"", has_body)
            whole, asked = path.read_bytes(), self.headers.get("Range")
            headers = {"ETag": f'"{len(whole)}"', "Accept-Ranges": "bytes"}
            if asked is None:
                return self.give(200, whole, has_body, headers)
            first, last = asked.removeprefix("bytes=").split("-")
            first, last = int(first), min(int(last or len(whole) - 1), len(whole) - 1)
            headers["Content-Range"] = f"bytes {first}-{last}/{len(whole)}"
            return self.give(206, whole[first : last + 1], has_body, headers)

        def give(self, status, body, has_body, headers=None):
            self.send_response(status)
            for name, value in (headers or {}).items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            if has_body:
                self.wfile.write(body)

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    port.with_suffix(".new").write_text(str(server.server_port))
    port.with_suffix(".new").rename(port)
    server.serve_forever()


MAKERS = {
    "robomimic, HDF5": lambda folder: robomimic(folder, None),
    "robomimic, HDF5, gzip": lambda folder: robomimic(folder, "gzip"),
    "robomimic, HDF5, gzip, decoded once": lambda folder: robomimic(folder, "gzip", "decoded"),
    "diffusion_policy, Zarr": diffusion_policy,
    "diffusion_policy, Zarr, as floats": lambda folder: diffusion_policy(folder, floats),
    "Lance by S3": lance,
}


def report(rows):
    lines = ["Clips per second of CPU time, best round", f"{'case':38}{'theirs, or local':>18}{'here':>12}{'ratio':>8}  wanted"]
    for row in rows:
        verdict = "met" if row["ratio"] >= (row["wanted"] or 0) else "MISSED"
        verdict = f">= {row['wanted']} {verdict}" if row["wanted"] else ""
        lines.append(f"{row['case']:38}{row['there']:>18.0f}{row['here']:>12.0f}{row['ratio']:>8.2f}  {verdict}")
    lines.append(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    return "\n".join(lines)


if __name__ == "__main__":
    main()

"""The reference's side of data.py: random clips per second out of datasets, by its own readers.

Reads one JSON line per request from stdin, {"kind", "path", "num_steps", "keys", "seconds"}, and answers with one line,
{"clips", "cpu_s", "wall_s"}. Clips are drawn at random and put into batches of 64 as torch's loader does, in this process
and on one thread. With "from", the dataset at "path" is first written with the reference's writer from that HDF5 file.
"""

import json
import random
import sys
import time

import torch

BATCH = 64


def collate(items):
    return {key: torch.stack([item[key] for item in items]) for key in items[0] if torch.is_tensor(items[0][key])}


def open_dataset(kind, path, num_steps, keys):
    from stable_worldmodel.data.formats import hdf5, lance

    reader = {"hdf5": hdf5.HDF5Dataset, "lance": lance.LanceDataset}[kind]
    return reader(path=path, num_steps=num_steps, keys_to_load=keys)


def write_lance(source, path, keys):
    import h5py
    import hdf5plugin  # noqa: F401, its filters
    from stable_worldmodel.data.formats import lance

    with h5py.File(source, "r") as file, lance.LanceWriter(path) as writer:
        places = zip(file["ep_offset"][:].tolist(), file["ep_len"][:].tolist())
        writer.write_episodes({key: list(file[key][first : first + rows]) for key in keys} for first, rows in places)


def measure(dataset, seconds):
    rng = random.Random(0)
    # As torch's loader: many at once where the dataset can.
    fetch = getattr(dataset, "__getitems__", lambda indices: [dataset[index] for index in indices])
    batch = lambda: collate(fetch([rng.randrange(len(dataset)) for _ in range(BATCH)]))
    batch()
    clips, cpu, wall = 0, time.process_time(), time.perf_counter()
    while time.perf_counter() - wall < seconds:
        batch()
        clips += BATCH
    return {"clips": clips, "cpu_s": time.process_time() - cpu, "wall_s": time.perf_counter() - wall}


def main():
    torch.set_num_threads(1)
    datasets = {}
    for line in sys.stdin:
        request = json.loads(line)
        key = (request["kind"], request["path"], request["num_steps"])
        if key not in datasets:
            if "from" in request:
                write_lance(request["from"], request["path"], request["keys"])
            datasets[key] = open_dataset(*key, request["keys"])
        print(json.dumps(measure(datasets[key], request["seconds"])), flush=True)


if __name__ == "__main__":
    main()

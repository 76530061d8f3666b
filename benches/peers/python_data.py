"""Cases of python.py: clips as torch tensors, from our Loader, from the core alone, from the reference in a DataLoader.

PushT is recorded with random actions by this package, in each of the two processes. Batches of 64 shuffled clips of `pixels`,
`action` and `proprio`, on one thread. The core alone reads the same batches and drops them.
"""

import atexit
import functools
import shutil
import tempfile
from pathlib import Path

from python_cases import Case

KEYS = ["pixels", "action", "proprio"]
BATCH = 64
EPISODES = 40
ROWS = 100


@functools.cache
def recording(side):
    """A file of images of this size."""
    import stable_worldmodel_rs as swm

    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    world = swm.World("swm/PushT-v1", num_envs=8, image_shape=(side, side), max_episode_steps=ROWS)
    world.set_policy("random")
    world.collect(Path(folder) / "pusht.h5", episodes=EPISODES, seed=0, progress=False)
    world.close()
    return Path(folder) / "pusht.h5"


def endless(loader):
    """One batch per call, epoch after epoch: a function that says how many clips it had."""

    def batches():
        while True:
            for batch in loader:
                yield len(batch["action"])

    return functools.partial(next, batches())


class Clips(Case):
    """Clips of so many images of a size."""

    def __init__(self, name, size, steps):
        self.name = f"{name}, {steps} × {size}²"
        self.size = size
        self.steps = steps

    def dataset(self):
        import stable_worldmodel_rs as swm

        return swm.data.HDF5Dataset(path=recording(self.size), num_steps=self.steps, keys_to_load=KEYS)

    def reference(self):
        import torch
        from stable_worldmodel.data import HDF5Dataset

        torch.set_num_threads(1)
        dataset = HDF5Dataset(path=recording(self.size), num_steps=self.steps, keys_to_load=KEYS)
        return endless(torch.utils.data.DataLoader(dataset, BATCH, shuffle=True, drop_last=True))


class OfTheReference(Clips):
    """Our loader beside the reference's dataset in torch's DataLoader, in one process."""

    least_ratio = 10

    def ours(self):
        import stable_worldmodel_rs as swm

        return endless(swm.data.Loader(self.dataset(), BATCH, threads=1, drop_last=True, output="torch"))


class InADataLoader(Clips):
    """Our dataset in torch's DataLoader beside the reference's in one."""

    def ours(self):
        import stable_worldmodel_rs as swm
        import torch

        torch.set_num_threads(1)
        loader = torch.utils.data.DataLoader(
            self.dataset(), BATCH, shuffle=True, drop_last=True, collate_fn=swm.data.collate
        )
        return endless(loader)


class OfRust(OfTheReference):
    """Our loader; what stands as the reference is the core alone."""

    least_ratio = 0.95

    def reference(self):
        from stable_worldmodel_rs import _swm

        reader = _swm.ClipReader(self.dataset().reader, num_steps=self.steps, keys=KEYS, threads=1)
        stream = reader.batches(BATCH, shuffle=0, drop_last=True)
        # At the end of an epoch there is one call without clips.
        return lambda: stream.skip(1)


SIZES = [(224, 4), (64, 16)]
CASES = [
    *(OfTheReference("Loader to torch", size, steps) for size, steps in SIZES),
    *(InADataLoader("dataset in a DataLoader", size, steps) for size, steps in SIZES),
    *(OfRust("Loader, of Rust alone", size, steps) for size, steps in SIZES),
]

#!/usr/bin/env python3
"""Records episodes of every environment of the installed package, and prints the SHA-256 of each file: on another machine, the same.

    python3 tests/interop/recordings.py FOLDER > here.txt

Two short episodes with images by the random policy. Of MuJoCo's environments the digests include that of its library, which is another
on another platform.
"""

import hashlib
import sys
from pathlib import Path

import stable_worldmodel_rs as swm


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True)
    for env in sorted(swm.envs.WORLDS):
        path = folder / f"{env.removeprefix('swm/')}.h5"
        world = swm.World(env, num_envs=2, image_shape=(32, 32), max_episode_steps=8)
        world.set_policy(swm.policy.RandomPolicy(seed=3))
        world.collect(path, episodes=2, seed=7)
        print(env, hashlib.sha256(path.read_bytes()).hexdigest(), flush=True)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Runs Meta-World's environments here and in metaworld, side by side.

    python3 benches/peers/meta_world.py [--rounds 5] [--venv FOLDER] [--check]

Installs metaworld 3.1.1 with MuJoCo 3.17.0 into a virtual environment of its own (its images need EGL: Debian's libegl1 and
libgl1-mesa-dri), builds `env-rates`, measures both in turns, and prints ratios of medians in CPU time: steps without images,
steps with images of 64 x 64, and resets. Needs `cargo xtask setup`.
"""

import peer

ENVS = ["swm/MetaWorldPickPlace-v0", "swm/MetaWorldDrawerOpen-v0"]

# (case here, of metaworld, least ratio wanted)
PAIRS = [("step/none", "bare", 2), ("step/64/exact", "images", 50), ("reset/none", "reset", 1)]

CASES = peer.cases_of(ENVS, PAIRS)

if __name__ == "__main__":
    requirements, script = ["requirements-metaworld.txt"], "meta_world_reference.py"
    peer.compare_rates(__doc__, "metaworld", "metaworld", requirements, script, ENVS, CASES)

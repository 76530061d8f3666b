#!/usr/bin/env python3
"""Runs OGBench's humanoid maze and AntSoccer here and in the published package, side by side.

    python3 benches/peers/mazes.py [--rounds 5] [--venv FOLDER] [--check]

Installs ogbench 1.2.2 with MuJoCo 3.17.0 into a virtual environment of its own (its images need EGL: Debian's libegl1 and
libgl1-mesa-dri), builds `env-rates`, measures both in turns, and prints ratios of medians in CPU time: steps without images
and with images of 64 x 64, and resets. Needs `cargo xtask setup`.
"""

import peer

ENVS = ["swm/OGBHumanoidMaze-v0", "swm/OGBAntSoccer-v0"]

# (case here, of the package, least ratio wanted)
PAIRS = [("step/none", "bare", 0.9), ("step/64/exact", "images", 20), ("reset/none", "reset", 1)]

CASES = peer.cases_of(ENVS, PAIRS)

if __name__ == "__main__":
    requirements, script = ["requirements-ogb.txt", "requirements-mazes.txt"], "mazes_reference.py"
    peer.compare_rates(__doc__, "ogbench", "mazes", requirements, script, ENVS, CASES)

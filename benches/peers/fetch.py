#!/usr/bin/env python3
"""Runs the Fetch environments here and in gymnasium-robotics, side by side.

    python3 benches/peers/fetch.py [--rounds 5] [--venv FOLDER] [--check]

Installs gymnasium-robotics 1.4.2 with MuJoCo 3.17.0 into a virtual environment of its own (its images need EGL: Debian's
libegl1 and libgl1-mesa-dri), builds `env-rates`, measures both in turns, and prints ratios of medians in CPU time: steps
without images, steps with images (of 64 x 64 here, of 480 x 480 there: the reference makes them smaller), and resets. Needs `cargo xtask setup`.
"""

import peer

ENVS = ["swm/FetchPush-v3", "swm/FetchPickAndPlace-v3"]

# (case here, of gymnasium-robotics, least ratio wanted)
PAIRS = [("step/none", "bare", 1.8), ("step/64/exact", "images", 50), ("reset/none", "reset", 1)]

CASES = peer.cases_of(ENVS, PAIRS)

if __name__ == "__main__":
    requirements, script = ["requirements-fetch.txt"], "fetch_reference.py"
    peer.compare_rates(__doc__, "gymnasium", "fetch", requirements, script, ENVS, CASES)

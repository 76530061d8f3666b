#!/usr/bin/env python3
"""Runs SimpleNavigation and SimplePointMaze here and in the Python reference, side by side.

    python3 benches/peers/rooms.py [--rounds 5] [--venv FOLDER] [--check]

Installs stable-worldmodel 0.0.3, the release that has both, with MiniGrid and Matplotlib, which draw them, into a virtual
environment of its own, builds `env-rates`, measures both in turns, and prints ratios of medians in CPU time: steps without
images and with images of 64 x 64, and resets.
"""

import peer

ENVS = ["swm/SimpleNavigation-v0", "swm/SimplePointMaze-v0"]

# (case here, of the reference, least ratio wanted)
PAIRS = [("step/none", "bare", 20), ("step/64/exact", "images", 20), ("reset/64/exact", "reset", 5)]

CASES = peer.cases_of(ENVS, PAIRS)

if __name__ == "__main__":
    requirements, script = ["requirements.txt", "requirements-rooms.txt"], "rooms_reference.py"
    peer.compare_rates(__doc__, "reference", "rooms", requirements, script, ENVS, CASES)

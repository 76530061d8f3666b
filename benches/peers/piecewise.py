#!/usr/bin/env python3
"""Runs Piecewise here and in the Python reference of August 2026, side by side.

    python3 benches/peers/piecewise.py [--rounds 5] [--venv FOLDER] [--check]

As rooms.py, in the virtual environment of two_room_v2.py (stable-worldmodel 0.1.1, with torch: gigabytes).
"""

import peer
from rooms import PAIRS

ENVS = ["swm/Piecewise-v0"]

if __name__ == "__main__":
    place, requirements = peer.REFERENCE
    peer.compare_rates(__doc__, "reference", place, requirements, "rooms_reference.py", ENVS, peer.cases_of(ENVS, PAIRS))

#!/usr/bin/env python3
"""Runs TwoRoom-v2 here and in the Python reference of August 2026, side by side.

    python3 benches/peers/two_room_v2.py [--rounds 5] [--venv FOLDER] [--check]

As world.py does for PushT: installs the reference (stable-worldmodel 0.1.1, with torch: gigabytes) into a virtual environment
of its own, builds `env-rates`, measures both in turns, and prints ratios of medians in CPU time.
"""

import peer

ENV_ID = "swm/TwoRoom-v2"

# (case here, of the reference, least ratio wanted)
PAIRS = [
    ("step/64/exact", "step", 20),
    ("step/64/fast", "step", 20),
    ("reset/64/exact", "reset", 30),
    ("reset/64/fast", "reset", 30),
]

CASES = [(ours, f"{ENV_ID} {ours}", theirs, target) for ours, theirs, target in PAIRS]

if __name__ == "__main__":
    place, requirements = peer.REFERENCE
    script = "two_room_v2_reference.py"
    peer.compare_rates(__doc__, "reference", place, requirements, script, [ENV_ID], CASES)

#!/usr/bin/env python3
"""Runs rocket landing here and in PyFlyt, side by side.

    python3 benches/peers/rocket.py [--rounds 5] [--venv FOLDER] [--check]

Installs PyFlyt 0.29.0 with PyBullet 3.2.7 into a virtual environment of its own, builds `env-rates`, measures both in turns,
and prints ratios of medians in CPU time: steps without images, steps with images of 64 x 64, and resets.
"""

import peer

ENV = "swm/PFRocketLanding-v0"

# (case here, of PyFlyt, least ratio wanted)
PAIRS = [("step/none", "bare", 100), ("step/64/exact", "64", 20), ("reset/none", "reset", 100)]

CASES = [(ours, f"{ENV} {ours}", theirs, target) for ours, theirs, target in PAIRS]

if __name__ == "__main__":
    requirements, script = ["requirements-rocket.txt"], "rocket_reference.py"
    peer.compare_rates(__doc__, "PyFlyt", "rocket", requirements, script, [ENV], CASES)

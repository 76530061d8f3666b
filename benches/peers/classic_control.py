#!/usr/bin/env python3
"""Runs classic control here and in Gymnasium, side by side.

    python3 benches/peers/classic_control.py [--rounds 5] [--venv FOLDER] [--check]

Installs Gymnasium 1.2.3 with pygame into a virtual environment of its own, builds `env-rates`, measures both in turns, and
prints ratios of medians in CPU time: steps without images, and with images of 64 x 64 (Gymnasium's image, resized by Pillow
as the reference does).
"""

import peer

ENVS = {
    "swm/CartPoleControl-v1": "CartPole-v1",
    "swm/MountainCarControl-v0": "MountainCar-v0",
    "swm/MountainCarContinuousControl-v0": "MountainCarContinuous-v0",
    "swm/AcrobotControl-v1": "Acrobot-v1",
    "swm/PendulumControl-v1": "Pendulum-v1",
}

# (case here, of Gymnasium, least ratio wanted)
PAIRS = [("step/none", "bare", 20), ("step/64/exact", "64", 20), ("step/64/fast", "64", 20)]

CASES = [
    (f"{env} {ours}", f"{env} {ours}", f"{name} {theirs}", target)
    for env, name in ENVS.items()
    for ours, theirs, target in PAIRS
]

if __name__ == "__main__":
    requirements, script = ["requirements-classic-control.txt"], "classic_control_reference.py"
    peer.compare_rates(__doc__, "Gymnasium", "classic-control", requirements, script, ENVS, CASES)

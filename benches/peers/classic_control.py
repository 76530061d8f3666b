#!/usr/bin/env python3
"""Runs classic control here and in Gymnasium, side by side.

    python3 benches/peers/classic_control.py [--rounds 5] [--venv FOLDER] [--check]

Installs Gymnasium 1.2.3 with pygame into a virtual environment of its own, builds `env-rates`, measures both in turns, and
prints ratios of medians in CPU time: steps without images, and with images of 64 x 64 (Gymnasium's image, resized by Pillow
as the reference does).
"""

import argparse
import os
import statistics
import sys
from pathlib import Path

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


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=peer.folder("classic-control"))
    parser.add_argument("--env-rates", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="CPU time per measurement")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python = peer.environment(options.venv, ["requirements-classic-control.txt"])
    binary = options.env_rates or peer.build("swm-benches", "env-rates")
    rates = {}
    with peer.Peer(python, "classic_control_reference.py") as reference:
        for _ in range(options.rounds):
            for case, rate in reference.ask(options.seconds).items():
                rates.setdefault(case, []).append(rate)
            for env in ENVS:
                for measured in peer.own([binary, env, options.seconds]):
                    case = f"{env} {measured['case']}"
                    rates.setdefault(case, []).append(measured["count"] / measured["cpu_s"])
    sys.exit(1 if report(rates) and options.check else 0)


def report(rates):
    """Prints the table; returns how many targets are missed."""
    missed = 0
    print("Steps per second of CPU time, one environment, one thread: median of the rounds")
    print(f"{'environment':38}{'case':16}{'Gymnasium':>12}{'here':>12}{'ratio':>9}  target")
    for env, name in ENVS.items():
        for ours, theirs, target in PAIRS:
            own = statistics.median(rates[f"{env} {ours}"])
            other = statistics.median(rates[f"{name} {theirs}"])
            missed += own / other < target
            verdict = "met" if own / other >= target else "MISSED"
            print(f"{env:38}{ours:16}{other:12,.0f}{own:12,.0f}{own / other:9.1f}  >= {target} {verdict}")
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    return missed


if __name__ == "__main__":
    main()

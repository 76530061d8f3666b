#!/usr/bin/env python3
"""Runs rocket landing here and in PyFlyt, side by side.

    python3 benches/peers/rocket.py [--rounds 5] [--venv FOLDER] [--check]

Installs PyFlyt 0.29.0 with PyBullet 3.2.7 into a virtual environment of its own, builds `env-rates`, measures both in turns,
and prints ratios of medians in CPU time: steps without images, steps with images of 64 x 64, and resets.
"""

import argparse
import os
import statistics
import sys
from pathlib import Path

import peer

ENV = "swm/PFRocketLanding-v0"

# (case here, of PyFlyt, least ratio wanted)
PAIRS = [("step/none", "bare", 100), ("step/64/exact", "64", 20), ("reset/none", "reset", 100)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=peer.folder("rocket"))
    parser.add_argument("--env-rates", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="CPU time per measurement")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python = peer.environment(options.venv, ["requirements-rocket.txt"])
    binary = options.env_rates or peer.build("swm-benches", "env-rates")
    rates = {}
    with peer.Peer(python, "rocket_reference.py") as reference:
        for _ in range(options.rounds):
            for case, rate in reference.ask(options.seconds).items():
                rates.setdefault(case, []).append(rate)
            for measured in peer.own([binary, ENV, options.seconds]):
                rates.setdefault(measured["case"], []).append(measured["count"] / measured["cpu_s"])
    sys.exit(1 if report(rates) and options.check else 0)


def report(rates):
    """Prints the table; returns how many targets are missed."""
    missed = 0
    print("Per second of CPU time, one environment, one thread: median of the rounds")
    print(f"{'case':16}{'PyFlyt':>12}{'here':>12}{'ratio':>9}  target")
    for ours, theirs, target in PAIRS:
        own, other = statistics.median(rates[ours]), statistics.median(rates[theirs])
        missed += own / other < target
        verdict = "met" if own / other >= target else "MISSED"
        print(f"{ours:16}{other:12,.0f}{own:12,.0f}{own / other:9.1f}  >= {target} {verdict}")
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    return missed


if __name__ == "__main__":
    main()

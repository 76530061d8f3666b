#!/usr/bin/env python3
"""Runs TwoRoom-v2 here and in the Python reference of August 2026, side by side.

    python3 benches/peers/two_room_v2.py [--rounds 5] [--venv FOLDER] [--check]

As world.py does for PushT: installs the reference (stable-worldmodel 0.1.1, with torch: gigabytes) into a virtual environment
of its own, builds `env-rates`, measures both in turns, and prints ratios of medians in CPU time.
"""

import argparse
import os
import statistics
import sys
from pathlib import Path

import peer

ENV_ID = "swm/TwoRoom-v2"

# (case here, of the reference, least ratio wanted)
PAIRS = [
    ("step/64/exact", "step", 20),
    ("step/64/fast", "step", 20),
    ("reset/64/exact", "reset", 30),
    ("reset/64/fast", "reset", 30),
]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=peer.folder(peer.REFERENCE[0]))
    parser.add_argument("--env-rates", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="CPU time per measurement")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python = peer.environment(options.venv, peer.REFERENCE[1])
    binary = options.env_rates or peer.build("swm-benches", "env-rates")
    rates = {}
    with peer.Peer(python, "two_room_v2_reference.py") as reference:
        for _ in range(options.rounds):
            for case, rate in reference.ask(options.seconds).items():
                rates.setdefault(case, []).append(rate)
            for measured in peer.own([binary, ENV_ID, options.seconds]):
                rates.setdefault(measured["case"], []).append(measured["count"] / measured["cpu_s"])
    sys.exit(1 if report(rates) and options.check else 0)


def report(rates):
    """Prints the table; returns how many targets are missed."""
    missed = 0
    print("Per second of CPU time, one environment, one thread, 64 x 64: median of the rounds")
    print(f"{'case':16}{'reference':>12}{'here':>12}{'ratio':>9}  target")
    for ours, theirs, target in PAIRS:
        own, other = (statistics.median(rates[case]) for case in (ours, theirs))
        missed += own / other < target
        verdict = "met" if own / other >= target else "MISSED"
        print(f"{ours:16}{other:12,.0f}{own:12,.0f}{own / other:9.1f}  >= {target} {verdict}")
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    return missed


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Runs OGBench's cube or scene here and in the published package, side by side.

    python3 benches/peers/ogb.py [cube|scene] [--rounds 5] [--venv FOLDER] [--check]

Installs ogbench 1.2.2 into a virtual environment of its own (its images need EGL: Debian's libegl1 and libgl1-mesa-dri), builds
`table-rates`, measures both in turns, and prints ratios of medians in CPU time. There the environment alone steps, here a world
with it, which writes every column.
"""

import argparse
import os
import statistics
import sys
from pathlib import Path

import peer

IDS = {"cube": "swm/OGBCube-v0", "scene": "swm/OGBScene-v0"}

# (case here, of the reference, least ratio wanted)
PAIRS = [("step/none", "none", 1.8), ("step/64", "64", 130), ("step/224", "224", 40)]
# Milliseconds that a reset may take.
LIMITS = {"color": 5, "floor": 5, "size": 60}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("env", nargs="?", choices=IDS, default="cube")
    parser.add_argument("--venv", type=Path, default=peer.folder("ogb"))
    parser.add_argument("--table-rates", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="CPU time per measurement")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python = peer.environment(options.venv, ["requirements-ogb.txt"])
    binary = options.table_rates or peer.build("swm-benches", "table-rates")
    rates = {}
    with peer.Peer(python, "ogb_reference.py", options.env) as reference:
        for _ in range(options.rounds):
            for case, rate in reference.ask(options.seconds).items():
                rates.setdefault(case, []).append(rate)
            for measured in peer.own([binary, IDS[options.env], options.seconds]):
                rates.setdefault(measured["case"], []).append(measured["count"] / measured["cpu_s"])
    sys.exit(1 if report(rates) and options.check else 0)


def report(rates):
    """Prints the tables; returns how many targets are missed."""
    missed = 0
    print("Steps per second of CPU time, one environment, one thread: median of the rounds")
    print(f"{'case':16}{'reference':>12}{'here':>12}{'ratio':>9}  target")
    for ours, theirs, target in PAIRS:
        own, other = (statistics.median(rates[case]) for case in (ours, theirs))
        missed += own / other < target
        verdict = "met" if own / other >= target else "MISSED"
        print(f"{ours:16}{other:12,.1f}{own:12,.0f}{own / other:9.1f}  >= {target} {verdict}")
    print("Milliseconds of CPU time per reset, image of the goal included")
    for case in sorted(case for case in rates if case.startswith("reset/")):
        took, limit = 1000 / statistics.median(rates[case]), LIMITS.get(case.rsplit("/", 1)[1])
        missed += limit is not None and took >= limit
        verdict = "" if limit is None else f"  < {limit} {'met' if took < limit else 'MISSED'}"
        print(f"{case:20}{took:9.2f}{verdict}")
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    return missed


if __name__ == "__main__":
    main()

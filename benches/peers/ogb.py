#!/usr/bin/env python3
"""Runs OGBench's cube or scene here and in the published package, side by side.

    python3 benches/peers/ogb.py [cube|scene] [--rounds 5] [--venv FOLDER] [--check]

Installs ogbench 1.2.2 into a virtual environment of its own (its pictures need EGL: Debian's libegl1 and libgl1-mesa-dri), builds
`table-rates`, measures both in turns, and prints ratios of medians in processor time. There the environment alone steps, here a world
with it, which writes every column.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
IDS = {"cube": "swm/OGBCube-v0", "scene": "swm/OGBScene-v0"}

# (case here, of the reference, least ratio wanted)
PAIRS = [("step/none", "none", 1.8), ("step/64", "64", 130), ("step/224", "224", 40)]
# Milliseconds that a reset may take.
LIMITS = {"color": 5, "floor": 5, "size": 60}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("env", nargs="?", choices=IDS, default="cube")
    parser.add_argument("--venv", type=Path, default=ROOT / ".tools/peers/ogb")
    parser.add_argument("--table-rates", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="processor time per measurement")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python, binary = make_environment(options.venv), options.table_rates or build()
    command = [python, "-W", "ignore", HERE / "ogb_reference.py", options.env]
    rates = {}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as reference:
        for _ in range(options.rounds):
            reference.stdin.write(f"{options.seconds}\n")
            reference.stdin.flush()
            answer = reference.stdout.readline() or sys.exit("the reference stopped; its message stands above")
            for case, rate in json.loads(answer).items():
                rates.setdefault(case, []).append(rate)
            own = subprocess.run([binary, IDS[options.env], str(options.seconds)], stdout=subprocess.PIPE, check=True)
            for measured in json.loads(own.stdout):
                rates.setdefault(measured["case"], []).append(measured["count"] / measured["cpu_s"])
        reference.stdin.close()
    sys.exit(1 if report(rates) and options.check else 0)


def make_environment(folder):
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists():
        venv.create(folder, with_pip=True)
        requirements = HERE / "requirements-ogb.txt"
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--no-deps", "-r", requirements], check=True)
    return python


def build():
    command = ["cargo", "build", "--release", "--quiet", "-p", "swm-benches", "--bin", "table-rates"]
    subprocess.run(command, cwd=ROOT, check=True)
    metadata = subprocess.check_output(["cargo", "metadata", "--format-version", "1", "--no-deps"], cwd=ROOT)
    name = "table-rates.exe" if os.name == "nt" else "table-rates"
    return Path(json.loads(metadata)["target_directory"]) / "release" / name


def report(rates):
    """Prints the tables; returns how many targets are missed."""
    missed = 0
    print("Steps per second of processor time, one environment, one thread: median of the rounds")
    print(f"{'case':16}{'reference':>12}{'here':>12}{'ratio':>9}  target")
    for ours, theirs, target in PAIRS:
        own, other = (statistics.median(rates[case]) for case in (ours, theirs))
        missed += own / other < target
        verdict = "met" if own / other >= target else "MISSED"
        print(f"{ours:16}{other:12,.1f}{own:12,.0f}{own / other:9.1f}  >= {target} {verdict}")
    print("Milliseconds of processor time per reset, picture of the goal included")
    for case in sorted(case for case in rates if case.startswith("reset/")):
        took, limit = 1000 / statistics.median(rates[case]), LIMITS.get(case.rsplit("/", 1)[1])
        missed += limit is not None and took >= limit
        verdict = "" if limit is None else f"  < {limit} {'met' if took < limit else 'MISSED'}"
        print(f"{case:20}{took:9.2f}{verdict}")
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    return missed


if __name__ == "__main__":
    main()

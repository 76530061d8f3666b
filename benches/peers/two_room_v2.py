#!/usr/bin/env python3
"""Runs TwoRoom-v2 here and in the Python reference of August 2026, side by side.

    python3 benches/peers/two_room_v2.py [--rounds 5] [--venv FOLDER] [--check]

As world.py does for PushT: installs the reference (stable-worldmodel 0.1.1, with torch: gigabytes) into a virtual environment
of its own, builds `env-rates`, measures both in turns, and prints ratios of medians in processor time.
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
    parser.add_argument("--venv", type=Path, default=ROOT / ".tools/peers/two_room_v2")
    parser.add_argument("--env-rates", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="processor time per measurement")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python, binary = make_environment(options.venv), options.env_rates or build()
    command = [python, "-W", "ignore", HERE / "two_room_v2_reference.py"]
    rates = {}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as reference:
        for _ in range(options.rounds):
            reference.stdin.write(f"{options.seconds}\n")
            reference.stdin.flush()
            answer = reference.stdout.readline() or sys.exit("the reference stopped; its message stands above")
            for case, rate in json.loads(answer).items():
                rates.setdefault(case, []).append(rate)
            own = subprocess.run([binary, ENV_ID, str(options.seconds)], stdout=subprocess.PIPE, check=True)
            for measured in json.loads(own.stdout):
                rates.setdefault(measured["case"], []).append(measured["count"] / measured["cpu_s"])
        reference.stdin.close()
    sys.exit(1 if report(rates) and options.check else 0)


def make_environment(folder):
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists():
        venv.create(folder, with_pip=True)
        requirements = HERE / "requirements-two-room-v2.txt"
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--no-deps", "-r", requirements], check=True)
    return python


def build():
    command = ["cargo", "build", "--release", "--quiet", "-p", "swm-benches", "--bin", "env-rates"]
    subprocess.run(command, cwd=ROOT, check=True)
    metadata = subprocess.check_output(["cargo", "metadata", "--format-version", "1", "--no-deps"], cwd=ROOT)
    return Path(json.loads(metadata)["target_directory"]) / "release" / ("env-rates.exe" if os.name == "nt" else "env-rates")


def report(rates):
    """Prints the table; returns how many targets are missed."""
    missed = 0
    print("Per second of processor time, one environment, one thread, 64 x 64: median of the rounds")
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

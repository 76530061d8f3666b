#!/usr/bin/env python3
"""Runs the DeepMind Control Suite here, in dm_control, and in the Python reference's World, side by side.

    python3 benches/peers/dmc.py [--rounds 5] [--python INTERPRETER] [--check]
    python3 benches/peers/dmc.py --resets | --threads      # what needs no peer

As two_room_v2.py does: installs the peers (dm_control 1.0.50 on MuJoCo 3.17.0, stable-worldmodel 0.1.1 with torch: gigabytes) into a
virtual environment of its own, builds `suite-rates`, measures both in turns, and prints ratios of medians in processor time.
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

# (case, of whom, least ratio wanted)
TARGETS = [
    ("control/cheetah", "dm_control", 4.5),
    ("control/humanoid", "dm_control", 1.8),
    ("world/cheetah", "the reference's World", 30),
    ("world/humanoid", "the reference's World", 3),
]
# Milliseconds per reset: with a factor that edits the model, and with one that compiles it anew.
RESET_TARGET_MS = 5.0
PARALLEL_TARGET = 1.8


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=ROOT / ".tools/peers/dmc")
    parser.add_argument("--python", type=Path, help="an interpreter that has the peers; default: one in --venv")
    parser.add_argument("--suite-rates", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="processor time per measurement")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    parser.add_argument("--resets", action="store_true", help="measure resets with every factor")
    parser.add_argument("--threads", action="store_true", help="measure eight environments on one thread and two")
    options = parser.parse_args()
    binary = options.suite_rates or build()
    if options.resets:
        missed = report_resets(own(binary, "resets", options.seconds))
    elif options.threads:
        missed = report_threads([own(binary, "threads", options.seconds) for _ in range(options.rounds)])
    else:
        missed = report_steps(rates(binary, options.python or make_environment(options.venv), options))
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    sys.exit(1 if missed and options.check else 0)


def rates(binary, python, options):
    """By case: rates here and of the peer, one of each per round."""
    ours, theirs = {}, {}
    command = [python, "-W", "ignore", HERE / "dmc_reference.py"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as peer:
        for _ in range(options.rounds):
            peer.stdin.write(f"{options.seconds}\n")
            peer.stdin.flush()
            answer = peer.stdout.readline() or sys.exit("the peer stopped; its message stands above")
            for case, rate in json.loads(answer).items():
                theirs.setdefault(case, []).append(rate)
            for measured in own(binary, "steps", options.seconds):
                ours.setdefault(measured["case"], []).append(measured["count"] / measured["cpu_s"])
        peer.stdin.close()
    return ours, theirs


def own(binary, what, seconds):
    return json.loads(subprocess.run([binary, what, str(seconds)], stdout=subprocess.PIPE, check=True).stdout)


def make_environment(folder):
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists():
        venv.create(folder, with_pip=True)
        pip = [python, "-m", "pip", "install", "--quiet", "--no-deps"]
        for requirements in ("requirements-two-room-v2.txt", "requirements-dmc.txt"):
            subprocess.run([*pip, "-r", HERE / requirements], check=True)
    return python


def build():
    command = ["cargo", "build", "--release", "--quiet", "-p", "swm-benches", "--bin", "suite-rates"]
    subprocess.run(command, cwd=ROOT, check=True)
    metadata = subprocess.check_output(["cargo", "metadata", "--format-version", "1", "--no-deps"], cwd=ROOT)
    return Path(json.loads(metadata)["target_directory"]) / "release" / ("suite-rates.exe" if os.name == "nt" else "suite-rates")


def report_steps(measured):
    """Prints the table; returns how many targets are missed."""
    ours, theirs = measured
    missed = 0
    print("Steps per second of processor time, one environment, one thread, no pictures: median of the rounds (best)")
    print(f"{'case':20}{'peer':>18}{'here':>20}{'ratio':>8}  target")
    for case, peer, target in TARGETS:
        own_rate, other = statistics.median(ours[case]), statistics.median(theirs[case])
        ratio = own_rate / other
        missed += ratio < target
        verdict = "met" if ratio >= target else "MISSED"
        here, there = (f"{median:,.0f} ({max(all_):,.0f})" for median, all_ in ((own_rate, ours[case]), (other, theirs[case])))
        print(f"{case:20}{there:>18}{here:>20}{ratio:8.1f}  >= {target} x {peer}: {verdict}")
    return missed


def report_resets(measured):
    print("Milliseconds of processor time per reset, by the factor that is drawn")
    missed = 0
    for row in measured:
        milliseconds = 1000 * row["cpu_s"] / row["count"]
        missed += milliseconds > RESET_TARGET_MS
        print(f"{row['case']:56}{milliseconds:9.3f}")
    return missed


def report_threads(rounds):
    """Wall time means something on an idle machine only: the best round of each counts."""
    best = {}
    for measured in rounds:
        for row in measured:
            rate, cost = row["count"] / row["wall_s"], row["cpu_s"] / row["count"]
            best_rate, least_cost = best.get(row["case"], (0.0, float("inf")))
            best[row["case"]] = max(rate, best_rate), min(cost, least_cost)
    missed = 0
    print("World steps of eight environments per second of wall time, and processor time per step: best of the rounds")
    for domain in sorted({case.split("/")[1] for case in best}):
        (one, one_cost), (two, two_cost) = best[f"world8/{domain}/1"], best[f"world8/{domain}/2"]
        missed += two / one < PARALLEL_TARGET
        costs = f"{1e6 * one_cost:.1f} and {1e6 * two_cost:.1f} us per step"
        print(f"{domain:10}{one:12,.0f} on one thread{two:12,.0f} on two: x {two / one:.2f} (target {PARALLEL_TARGET}); {costs}")
    return missed


if __name__ == "__main__":
    main()

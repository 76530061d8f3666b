#!/usr/bin/env python3
"""Runs the DeepMind Control Suite here, in dm_control, and in the Python reference's World, side by side.

    python3 benches/peers/dmc.py [--rounds 5] [--python INTERPRETER] [--check]
    python3 benches/peers/dmc.py --resets | --threads      # what needs no peer

As two_room_v2.py does: installs the peers (dm_control 1.0.50 on MuJoCo 3.17.0, stable-worldmodel 0.1.1 with torch: gigabytes) into a
virtual environment of its own, builds `suite-rates`, measures both in turns, and prints ratios of medians in CPU time.
"""

import argparse
import os
import statistics
import sys
from pathlib import Path

import peer

REQUIREMENTS = ["requirements-two-room-v2.txt", "requirements-dmc.txt"]
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
    parser.add_argument("--venv", type=Path, default=peer.folder("dmc"))
    parser.add_argument("--python", type=Path, help="an interpreter that has the peers; default: one in --venv")
    parser.add_argument("--suite-rates", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="CPU time per measurement")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    parser.add_argument("--resets", action="store_true", help="measure resets with every factor")
    parser.add_argument("--threads", action="store_true", help="measure eight environments on one thread and two")
    options = parser.parse_args()
    binary = options.suite_rates or peer.build("swm-benches", "suite-rates")
    if options.resets:
        missed = report_resets(peer.own([binary, "resets", options.seconds]))
    elif options.threads:
        missed = report_threads([peer.own([binary, "threads", options.seconds]) for _ in range(options.rounds)])
    else:
        python = options.python or peer.environment(options.venv, REQUIREMENTS)
        missed = report_steps(rates(binary, python, options))
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    sys.exit(1 if missed and options.check else 0)


def rates(binary, python, options):
    """By case: rates here and of the peer, one of each per round."""
    ours, theirs = {}, {}
    with peer.Peer(python, "dmc_reference.py") as reference:
        for _ in range(options.rounds):
            for case, rate in reference.ask(options.seconds).items():
                theirs.setdefault(case, []).append(rate)
            for measured in peer.own([binary, "steps", options.seconds]):
                ours.setdefault(measured["case"], []).append(measured["count"] / measured["cpu_s"])
    return ours, theirs


def report_steps(measured):
    """Prints the table; returns how many targets are missed."""
    ours, theirs = measured
    missed = 0
    print("Steps per second of CPU time, one environment, one thread, no images: median of the rounds (best)")
    print(f"{'case':20}{'peer':>18}{'here':>20}{'ratio':>8}  target")
    for case, whom, target in TARGETS:
        own_rate, other = statistics.median(ours[case]), statistics.median(theirs[case])
        ratio = own_rate / other
        missed += ratio < target
        verdict = "met" if ratio >= target else "MISSED"
        here, there = (f"{median:,.0f} ({max(all_):,.0f})" for median, all_ in ((own_rate, ours[case]), (other, theirs[case])))
        print(f"{case:20}{there:>18}{here:>20}{ratio:8.1f}  >= {target} x {whom}: {verdict}")
    return missed


def report_resets(measured):
    print("Milliseconds of CPU time per reset, by the factor that is drawn")
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
    print("World steps of eight environments per second of wall time, and CPU time per step: best of the rounds")
    for domain in sorted({case.split("/")[1] for case in best}):
        (one, one_cost), (two, two_cost) = best[f"world8/{domain}/1"], best[f"world8/{domain}/2"]
        missed += two / one < PARALLEL_TARGET
        costs = f"{1e6 * one_cost:.1f} and {1e6 * two_cost:.1f} us per step"
        print(f"{domain:10}{one:12,.0f} on one thread{two:12,.0f} on two: x {two / one:.2f} (target {PARALLEL_TARGET}); {costs}")
    return missed


if __name__ == "__main__":
    main()

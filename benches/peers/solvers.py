#!/usr/bin/env python3
"""Plans here and in the Python reference of August 2026, side by side, with a cost that is next to nothing.

    python3 benches/peers/solvers.py [--rounds 5] [--venv FOLDER] [--json result.json] [--check]

As world.py does for PushT: installs the reference (stable-worldmodel 0.1.1, with torch: gigabytes) into a virtual environment
of its own, builds `solve-times`, and measures both in turns. One episode, one thread, 300 candidates of 10 blocks of 2
values, 30 iterations. What is compared is the CPU time of the quickest plan of all rounds: that which other
programs disturbed least. Solvers that the reference lacks stand in the table alone.
"""

import argparse
import json
import os
import statistics
import sys
from pathlib import Path

import peer

# Solver: least ratio wanted.
TARGETS = {"cem": 3}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=peer.folder(peer.REFERENCE[0]))
    parser.add_argument("--solve-times", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=0.5, help="CPU time per solver and round")
    parser.add_argument("--json", type=Path, help="write everything there as JSON")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python = peer.environment(options.venv, peer.REFERENCE[1])
    binary = options.solve_times or peer.build("swm-benches", "solve-times")
    theirs, ours = {}, {}
    with peer.Peer(python, "solvers_reference.py") as reference:
        for _ in range(options.rounds):
            for name, times in reference.ask(options.seconds).items():
                theirs.setdefault(name, []).append({"best_s": min(times), "median_s": statistics.median(times)})
            for measured in peer.own([binary, options.seconds]):
                ours.setdefault(measured["solver"], []).append(measured)
    rows = compare(ours, theirs)
    print(report(rows))
    if options.json:
        options.json.write_text(json.dumps({"solvers": rows, "load": os.getloadavg()}, indent=2) + "\n")
    sys.exit(1 if options.check and any(row["met"] is False for row in rows) else 0)


def compare(ours, theirs):
    """One row per solver: the quickest plan of all rounds, and the middle of the rounds' medians, on both sides."""

    def times(rounds):
        if not rounds:
            return None
        return {
            "best_s": min(measured["best_s"] for measured in rounds),
            "median_s": statistics.median(measured["median_s"] for measured in rounds),
        }

    rows = []
    for name, rounds in ours.items():
        own, other, target = times(rounds), times(theirs.get(name)), TARGETS.get(name)
        ratio = {key: other[key] / own[key] for key in own} if other else None
        met = None if target is None or ratio is None else ratio["best_s"] >= target
        rows.append({"solver": name, "here": own, "reference": other, "ratio": ratio, "target": target, "met": met})
    return rows


def report(rows):
    lines = ["Milliseconds of CPU time per plan: the quickest (the median)"]
    lines.append(f"{'solver':22}{'reference':>20}{'here':>20}{'ratio':>9}{'of medians':>12}  target")

    def cell(times):
        return f"{1e3 * times['best_s']:.2f} ({1e3 * times['median_s']:.2f})" if times else "-"

    for row in rows:
        ratio, target = row["ratio"], row["target"]
        ratios = [f"{ratio[key]:.1f}" if ratio else "-" for key in ("best_s", "median_s")]
        wanted = f"  >= {target} {'met' if row['met'] else 'MISSED'}" if target else ""
        cells = f"{cell(row['reference']):>20}{cell(row['here']):>20}{ratios[0]:>9}{ratios[1]:>12}"
        lines.append(f"{row['solver']:22}{cells}{wanted}")
    lines.append(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    return "\n".join(lines)


if __name__ == "__main__":
    main()

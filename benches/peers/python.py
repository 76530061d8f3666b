#!/usr/bin/env python3
"""Runs this project's Python package and the Python reference side by side, and prints how many times faster this one is.

    python3 benches/peers/python.py --python venv/bin/python [--rounds 3] [--only world] [--json result.json]

The interpreter must have both packages (`cargo xtask wheel`, `pip install` of the wheel, and the reference with torch). Both
sides are measured in turns, so that whatever else the machine does disturbs both. Rates are per second of CPU time on
one thread; the best of all rounds counts. README.md says what the cases are.
"""

import argparse
import json
import platform
import sys
from pathlib import Path

import peer

SECONDS = 1.0


def main():
    options = arguments()
    with (
        peer.Peer(options.python, "python_cases.py", "ours", env=peer_env()) as ours,
        peer.Peer(options.python, "python_cases.py", "reference", env=peer_env()) as theirs,
    ):
        known = ours.ask({"list": True})["cases"]
        cases = [case for case in known if options.only in case["name"]]
        best = {}
        for turn in range(options.rounds):
            for case in cases:
                peer.note(f"round {turn + 1}: {case['name']}")
                sides = [("ours", ours), ("reference", theirs)] if case["has_reference"] else [("ours", ours)]
                for side, process in sides:
                    answer = process.ask({"case": case["name"], "seconds": options.seconds})
                    if "error" in answer:
                        sys.exit(f"{case['name']} ({side}): {answer['error']}")
                    rate = answer["count"] / answer["cpu_s"]
                    key = (case["name"], side)
                    best[key] = max(best.get(key, 0.0), rate)
    rows = [row(case, best) for case in cases]
    show(rows)
    if options.json:
        machine = {"machine": platform.machine(), "system": platform.system(), "python": platform.python_version()}
        options.json.write_text(json.dumps({"machine": machine, "cases": rows}, indent=1) + "\n")
    sys.exit(int(options.check and any(not found["reached"] for found in rows)))


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--python", default=sys.executable, help="an interpreter that has both packages")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of CPU time, per case and round")
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose name holds this")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--check", action="store_true", help="exit with 1 where a target is missed")
    return parser.parse_args()


def peer_env():
    single = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")
    return {name: "1" for name in single} | {"SDL_VIDEODRIVER": "dummy", "TQDM_DISABLE": "1"}


def row(case, best):
    """The figure of a case, and whether it is as good as is wanted."""
    ours, theirs = best[case["name"], "ours"], best.get((case["name"], "reference"))
    ratio = ours / theirs if theirs else None
    wanted = [
        case["least_ratio"] is None or (ratio or 0.0) >= case["least_ratio"],
        case["least_rate"] is None or ours >= case["least_rate"],
        case["most_us"] is None or 1e6 / ours <= case["most_us"],
    ]
    return {**case, "ours": ours, "reference": theirs, "ratio": ratio, "reached": all(wanted)}


def show(rows):
    width = max(len(found["name"]) for found in rows)
    print(f"{'case':{width}}  {'ours':>12}  {'reference':>12}  {'ratio':>8}  target")
    for found in rows:
        theirs = f"{found['reference']:,.0f}/s" if found["reference"] else "–"
        ratio = f"{found['ratio']:.1f}×" if found["ratio"] else "–"
        rate = f"{1e6 / found['ours']:.2f} µs" if found["most_us"] is not None else f"{found['ours']:,.0f}/s"
        targets = [("≥ {:g}×", "least_ratio"), ("≥ {:,g}/s", "least_rate"), ("≤ {:g} µs", "most_us")]
        target = ", ".join(text.format(found[name]) for text, name in targets if found[name] is not None)
        mark = "" if found["reached"] else "  missed"
        print(f"{found['name']:{width}}  {rate:>12}  {theirs:>12}  {ratio:>8}  {target}{mark}")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Loads random clips here and in the Python reference of August 2026, side by side, from the same data.

    python3 benches/peers/data.py [--rounds 5] [--venv FOLDER] [--json result.json] [--check]

As solvers.py: installs the reference (stable-worldmodel 0.1.1, with torch: gigabytes) into a virtual environment of its own,
builds `swm` and `load-rates`, records PushT, and measures both in turns. Batches of 64 shuffled clips of `pixels`, `action`
and `proprio`, channels first, one thread. The reference reads HDF5 as we recorded it, and a Lance table that its own writer
made of that; ours is HDF5 each time, the format to train from. What is compared is clips per second of CPU time, in the best round:
that which other programs disturbed least. Rows without a peer stand alone: frames drawn on demand, and the gain of a
second thread, which is in wall time and means something on an idle machine only.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import peer

KEYS = "pixels,action,proprio"

# Name, file, what the peer reads, steps of a clip, drawn side, least rate here per second of CPU time, least ratio.
CASES = [
    ("4 frames, 224 px", "224.h5", "hdf5", 4, None, None, 5),
    ("4 frames, 224 px, Lance", "224.h5", "lance", 4, None, None, 2),
    ("16 frames, 64 px", "64.h5", "hdf5", 16, None, 20_000, None),
    ("16 frames, 64 px, drawn", "rendered.h5", None, 16, 64, 19_000 / 16, None),
]
PARALLEL_TARGET = 1.8


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=peer.folder(peer.REFERENCE[0]))
    parser.add_argument("--binaries", type=Path, help="the folder of the release binaries; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="per case and round")
    parser.add_argument("--episodes", type=int, default=60, help="of 100 steps, in every file")
    parser.add_argument("--json", type=Path, help="write everything there as JSON")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python = peer.environment(options.venv, peer.REFERENCE[1])
    binaries = options.binaries or build()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        record(binaries, folder, options.episodes)
        rows = measure(python, binaries, folder, options)
    print(report(rows))
    if options.json:
        options.json.write_text(json.dumps({"cases": rows, "load": os.getloadavg()}, indent=2) + "\n")
    sys.exit(1 if options.check and any(row["met"] is False for row in rows) else 0)


def build():
    peer.build("swm-benches", "load-rates")
    return peer.build("swm", "swm").parent


def record(binaries, folder, episodes):
    common = ["--policy", "weak", "--episodes", str(episodes), "--max-steps", "100", "--without", "goal", "--quiet"]
    for side in (64, 224):
        size = ["--image-size", f"{side}x{side}", "--out", folder / f"{side}.h5"]
        subprocess.run([binaries / "swm", "collect", "swm/PushT-v1", *common, *size], check=True, stdout=subprocess.DEVNULL)
    drawn = ["--replayable", "--out", folder / "rendered.h5"]
    common = common[: common.index("--without")] + ["--quiet"]
    subprocess.run([binaries / "swm", "collect", "swm/PushT-v1", *common, *drawn], check=True, stdout=subprocess.DEVNULL)


def measure(python, binaries, folder, options):
    """One row per case: the best rate of all rounds, on both sides."""
    rows = {}
    with peer.Peer(python, "data_reference.py", env={"OMP_NUM_THREADS": "1"}) as reference:
        for _ in range(options.rounds):
            for name, file, kind, steps, drawn, least_rate, least_ratio in CASES:
                path = folder / file
                row = rows.setdefault(
                    name,
                    {"case": name, "here": 0.0, "reference": None, "gain": 0.0, "rate_wanted": least_rate, "ratio_wanted": least_ratio},
                )
                own = [binaries / "load-rates", path, str(steps), "--keys", KEYS, "--first"]
                own += ["--seconds", str(options.seconds), "--threads", "1,2"]
                own += ["--draw", str(drawn)] if drawn else []
                one, two = peer.own(own)
                row["here"] = max(row["here"], one["clips"] / one["cpu_s"])
                row["gain"] = max(row["gain"], two["clips"] / two["wall_s"] / (one["clips"] / one["wall_s"]))
                if kind is None:
                    continue
                request = {"kind": kind, "path": str(path), "num_steps": steps, "keys": KEYS.split(",")}
                if kind == "lance":
                    request |= {"from": str(path), "path": str(path.with_suffix(".lance"))}
                answer = reference.ask({**request, "seconds": options.seconds})
                row["reference"] = max(row["reference"] or 0.0, answer["clips"] / answer["cpu_s"])
    for row in rows.values():
        row["ratio"] = row["here"] / row["reference"] if row["reference"] else None
        checks = [(row["here"], row["rate_wanted"]), (row["ratio"], row["ratio_wanted"])]
        checks = [value >= wanted for value, wanted in checks if wanted is not None]
        row["met"] = all(checks) if checks else None
    return list(rows.values())


def report(rows):
    lines = ["Clips per second of CPU time, best round"]
    lines.append(f"{'case':26}{'reference':>12}{'here':>12}{'ratio':>8}{'2 threads':>11}  wanted")
    for row in rows:
        reference, ratio = (f"{row['reference']:.0f}", f"{row['ratio']:.1f}") if row["reference"] else ("-", "-")
        wanted = [f">= {row['rate_wanted']:.0f}/s"] if row["rate_wanted"] else []
        wanted += [f">= {row['ratio_wanted']} x"] if row["ratio_wanted"] else []
        verdict = "" if row["met"] is None else " met" if row["met"] else " MISSED"
        lines.append(
            f"{row['case']:26}{reference:>12}{row['here']:>12.0f}{ratio:>8}{row['gain']:>10.2f}x  {', '.join(wanted)}{verdict}"
        )
    lines.append(f"2 threads: wall time, wanted on an idle machine >= {PARALLEL_TARGET}")
    lines.append(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    return "\n".join(lines)


if __name__ == "__main__":
    main()

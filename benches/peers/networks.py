#!/usr/bin/env python3
"""Training steps and planning with the baselines, here and in the Python reference of August 2026, side by side.

    python3 benches/peers/networks.py [--rounds 3] [--threads 1] [--venv FOLDER] [--json result.json] [--check]

Installs the reference (stable-worldmodel 0.1.1, with torch: gigabytes) and transformers into a virtual environment of its own, builds the
example `network_times` of swm-baselines, and measures both in turns: LeWM's training step on 4 clips of 4 images (of the
*small* preset: on 64), and the costs of 300 plans of 5 blocks, alone and with gradients. What is compared is the CPU time of
the quickest call of all rounds: that which other programs disturbed least.
"""

import argparse
import json
import os
import sys
from pathlib import Path

import peer

# Case: greatest ratio of our time to the peer's that is wanted.
TARGETS = {
    "train:lewm:paper:4": 1.0,
    "train:lewm:small:64": 1.0,
    "plan:lewm:paper:300": 1.0,
    "descend:lewm:paper:300": None,
    "plan:lewm:small:300": None,
}
REQUIREMENTS = [*peer.REFERENCE[1], "requirements-networks.txt"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=peer.folder("networks"))
    parser.add_argument("--python", type=Path, help="a Python that has the packages already")
    parser.add_argument("--network-times", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=5.0, help="CPU time per case and round")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write everything there as JSON")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python = options.python or peer.environment(options.venv, REQUIREMENTS)
    binary = options.network_times or peer.build("swm-baselines", "network_times", kind="example")
    os.environ["RAYON_NUM_THREADS"] = str(options.threads)
    theirs, ours = {}, {}
    # Threads that spin while they wait would count as work, the more the busier the machine is.
    waiting = {"OMP_WAIT_POLICY": "passive", "GOMP_SPINCOUNT": "0"}
    with peer.Peer(python, "networks_reference.py", str(options.threads), env=waiting) as reference:
        for _ in range(options.rounds):
            for case in TARGETS:
                answer = reference.ask({"case": case, "seconds": options.seconds})
                theirs[case] = min(answer["cpu_s"], theirs.get(case, float("inf")))
                answer = peer.own([binary, case, options.seconds])
                ours[case] = min(answer["cpu_s"], ours.get(case, float("inf")))
    rows = [
        {"case": case, "ours_s": ours[case], "theirs_s": theirs[case], "ratio": ours[case] / theirs[case], "target": target}
        for case, target in TARGETS.items()
    ]
    print("| case | here | PyTorch | ratio | wanted |\n|---|---|---|---|---|")
    for row in rows:
        wanted = f"at most {row['target']}" if row["target"] else "–"
        print(f"| {row['case']} | {row['ours_s']:.3f} s | {row['theirs_s']:.3f} s | {row['ratio']:.2f} | {wanted} |")
    if options.json:
        options.json.write_text(json.dumps({"networks": rows, "threads": options.threads, "load": os.getloadavg()}, indent=2) + "\n")
    missed = [row for row in rows if row["target"] and row["ratio"] > row["target"]]
    sys.exit(1 if options.check and missed else 0)


if __name__ == "__main__":
    main()

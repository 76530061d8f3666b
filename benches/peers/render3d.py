#!/usr/bin/env python3
"""Draws 3D environments here and with MuJoCo's own renderer on a CPU, in turns, and prints how many times faster this is.

    python3 benches/peers/render3d.py [--rounds 3] [--check] [--venv FOLDER]

A frame is one control step and one image. Rates are per second of CPU time: each side runs twice, with few and with
many frames, and the difference counts, so that start-up does not. The reference draws through EGL (MUJOCO_GL=osmesa for
OSMesa) with Mesa's llvmpipe, shadows, reflections and all else at their defaults, as here. Last, this project's two
threads are compared with one, in wall time, which means something on an idle machine only.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import time
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
PACKAGES = ["mujoco==3.17.0", "dm_control==1.0.50", "ogbench==1.2.2"]
# (environment here, of the reference, side, least ratio wanted)
CASES = [
    ("swm/CheetahDMControl-v0", "cheetah", 64, 50),
    ("swm/CheetahDMControl-v0", "cheetah", 224, 16),
    ("swm/HumanoidDMControl-v0", "humanoid", 64, 45),
    ("swm/HumanoidDMControl-v0", "humanoid", 224, 14),
    ("swm/OGBCube-v0", "cube", 64, 100),
    ("swm/OGBCube-v0", "cube", 224, 40),
]
THREADS_TARGET = 1.8


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=ROOT / ".tools/peers/render3d")
    parser.add_argument("--binary", type=Path, help="the release example `image_rates`; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python, binary = make_environment(options.venv), options.binary or build()
    print(f"load {os.getloadavg()[0]:.1f}; medians of {options.rounds} rounds, frames per second of CPU time")
    print(f"{'environment':26} {'px':>4} {'here':>8} {'MuJoCo':>8} {'ratio':>7} {'wanted':>7}")
    misses = 0
    for env, name, side, wanted in CASES:
        if subprocess.run([binary, env, "8", "1"], capture_output=True).returncode != 0:
            print(f"{env:26} {side:4}  is not in this build")
            continue
        ours, theirs = [], []
        for _ in range(options.rounds):
            theirs.append(rate([python, "-W", "ignore", HERE / "render3d_reference.py", name, side], 10, 60))
            ours.append(rate([binary, env, side], 50, 1500 if side < 100 else 400))
        here, there = statistics.median(ours), statistics.median(theirs)
        misses += here / there < wanted
        print(f"{env:26} {side:4} {here:8.0f} {there:8.1f} {here / there:6.0f}x {wanted:6}x", flush=True)
    for env, _, side, _ in CASES[:4]:
        gains = [2 * wall([binary, env, side, 600, 1]) / wall([binary, env, side, 600, 2]) for _ in range(options.rounds)]
        print(f"{env:26} {side:4} two threads: {max(gains):.2f}x of one (wanted {THREADS_TARGET}x)")
        misses += max(gains) < THREADS_TARGET
    sys.exit(1 if misses and options.check else 0)


def rate(command, few, many):
    """Frames per second of CPU time."""
    return (many - few) / (cpu([*command, many]) - cpu([*command, few]))


def cpu(command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run(command)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def wall(command):
    start = time.perf_counter()
    run(command)
    return time.perf_counter() - start


def run(command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{command} failed:\n{done.stderr}")


def make_environment(folder):
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists():
        venv.create(folder, with_pip=True)
        pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
        subprocess.run([*pip, *PACKAGES], check=True)
    return python


def build():
    command = ["cargo", "build", "--release", "--quiet", "-p", "swm-envs-mujoco", "--example", "image_rates"]
    subprocess.run(command, cwd=ROOT, check=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    return target / "release/examples" / ("image_rates.exe" if os.name == "nt" else "image_rates")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Runs an environment here and in the Python reference, side by side, and prints how many times faster this one is.

    python3 benches/peers/world.py [--env swm/TwoRoom-v1] [--rounds 5] [--json result.json]

Installs the reference by name, version and hash into a virtual environment of its own, builds the release binaries, and
then measures both in turns: each round asks the reference for every case, and this project for the same ones, so that
whatever else the machine does disturbs both. Rates are per second of CPU time, which counts no waiting; medians
and the best of all rounds stand side by side. Needs only Python's standard library. README.md says what the cases are.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import peer

# By environment: the policies that act, and (case here, case of the reference, least ratio wanted or None).
ENVS = {
    "swm/PushT-v1": {
        "policies": ("random", "weak"),
        "pairs": [
            ("step/bare", "step/bare", 15),
            ("step/224/exact", "step/224", 7),
            ("step/64/exact", "step/64", 10),
            ("step/64/fast", "step/64", 40),
            ("step/224/fast", "step/224", None),
            ("record/64/exact", "record/64", 10),
            ("record/64/fast", "record/64", 20),
        ],
    },
    "swm/TwoRoom-v1": {
        "policies": ("random",),
        "pairs": [
            ("step/224/exact", "step/224", None),
            ("step/64/exact", "step/64", 10),
            ("step/64/fast", "step/64", 40),
            ("step/224/fast", "step/224", None),
            ("reset/64/exact", "reset/64", 30),
            ("reset/64/fast", "reset/64", 30),
            ("record/64/exact", "record/64", None),
            ("record/64/fast", "record/64", None),
        ],
    },
}
PARALLEL_TARGET = 1.7
# Every package is named with its hash, so nothing needs resolving; torch is left out (README.md).
PIP_OPTIONS = ("--no-deps", "--require-hashes", "--only-binary", ":all:")


def main():
    options = arguments()
    python = peer.environment(options.venv, ["requirements.txt"], PIP_OPTIONS)
    swm = (options.swm or peer.build("swm", "swm")).resolve()
    step_rates = (options.step_rates or peer.build("swm-benches", "step-rates")).resolve()
    result = {"machine": machine(), "load_at_start": os.getloadavg()}
    with peer.Peer(python, "reference.py", options.env) as reference:
        result["reference"] = reference.answer()
        samples, runs = measure(options, reference, swm, step_rates)
    result["load_at_end"] = os.getloadavg()
    result["rates"] = {case: summary(rates) for case, rates in samples.items()}
    result["env"] = options.env
    result["ratios"] = ratios(options.env, result["rates"])
    result["runs"] = [{**key_fields(key), **summary(rates)} for key, rates in runs.items()]
    result["parallel"] = parallel(result["runs"])
    print(report(result))
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    misses = [row for row in result["ratios"] + result["parallel"] if row["met"] is False]
    sys.exit(1 if options.check and misses else 0)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--env", choices=ENVS, default="swm/PushT-v1", help="what is measured")
    add("--venv", type=Path, default=peer.folder("world"), help="where the reference is installed")
    add("--swm", type=Path, help="the release binary `swm`; default: built by cargo")
    add("--step-rates", type=Path, help="the release binary `step-rates`; default: built by cargo")
    add("--rounds", type=int, default=5, help="how often every case is measured")
    add("--seconds", type=float, default=1.0, help="CPU time per measurement")
    add("--bench-seconds", type=float, default=0.5, help="wall time per measurement of `swm bench`")
    add("--json", type=Path, help="write everything there as JSON")
    add("--check", action="store_true", help="exit with status 1 if a target is missed")
    return parser.parse_args()


# ---- what is measured ----------------------------------------------------------------------------------------------


class Rate:
    """Steps or frames per second of CPU time and per second of the wall."""

    def __init__(self, cpu, wall):
        self.cpu, self.wall = cpu, wall

    @staticmethod
    def of(answer):
        return Rate(answer["count"] / answer["cpu_s"], answer["count"] / answer["wall_s"])


class Recording:
    """`swm collect` of one environment on one thread, with the CPU time of the whole process."""

    def __init__(self, swm, env, case, policy, seconds):
        self.swm, self.env, self.policy, self.seconds = swm, env, policy, seconds
        _, side, self.style = case.split("/")
        self.size = f"{side}x{side}"
        self.episodes = 20
        cpu_s = self.collect()["cpu_s"]
        self.episodes = max(20, round(self.episodes * seconds / cpu_s))

    def collect(self):
        with tempfile.TemporaryDirectory() as folder:
            command = [self.swm, "--quiet", "collect", self.env, "--json", "--out", Path(folder) / "own.h5"]
            command += ["--policy", self.policy, "--episodes", str(self.episodes), "--image-size", self.size]
            command += ["--env-option", f"render={self.style}", "--num-envs", "1", "--threads", "1"]
            start = time.perf_counter()
            process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            output = process.stdout.read()
            _, status, usage = os.wait4(process.pid, 0)
            wall_s = time.perf_counter() - start
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            sys.exit(f"`swm collect` stopped with status {process.returncode}")
        rows = json.loads(output)["rows"]
        return {"count": rows, "cpu_s": usage.ru_utime + usage.ru_stime, "wall_s": wall_s}

    def rate(self):
        return Rate.of(self.collect())


def measure(options, reference, swm, step_rates):
    """Rates by case, `ours/…` and `reference/…`, one per round; and those of `swm bench` by its parameters."""
    seconds = options.seconds
    pairs, policies = ENVS[options.env]["pairs"], ENVS[options.env]["policies"]
    recordings = {
        f"{case}/{policy}": Recording(swm, options.env, case, policy, seconds)
        for case, _, _ in pairs
        if case.startswith("record/")
        for policy in policies
    }
    samples, runs = {}, {}
    for number in range(1, options.rounds + 1):
        peer.note(f"round {number} of {options.rounds}, load {os.getloadavg()[0]:.1f}")
        for policy in policies:
            for theirs in sorted({theirs for _, theirs, _ in pairs}):
                name = f"{theirs}/{policy}"
                add(samples, f"reference/{name}", Rate.of(reference.ask({"case": name, "seconds": seconds})))
                for ours in (f"{ours}/{policy}" for ours, other, _ in pairs if other == theirs):
                    if ours in recordings:
                        rate = recordings[ours].rate()
                    else:
                        rate = Rate.of(peer.own([step_rates, seconds, ours, options.env])[0])
                    add(samples, f"ours/{ours}", rate)
        command = [swm, "--quiet", "bench", options.env, "--json", "--seconds", str(options.bench_seconds)]
        for line in peer.own(command):
            key = (line["image"] or "none", line["num_envs"], line["threads"])
            add(runs, key, Rate(None, line["steps_per_second"]))
    return samples, runs


# ---- what it comes to ----------------------------------------------------------------------------------------------


def summary(rates):
    result = {}
    for name in ("cpu", "wall"):
        values = [getattr(rate, name) for rate in rates if getattr(rate, name) is not None]
        if values:
            result |= {f"median_per_{name}_s": statistics.median(values), f"best_per_{name}_s": max(values)}
            result[f"all_per_{name}_s"] = values
    return result


def ratios(env, rates):
    """Ours over the reference's, by medians and by bests, in CPU time."""
    rows = []
    for policy in ENVS[env]["policies"]:
        for ours, theirs, target in ENVS[env]["pairs"]:
            own, other = rates[f"ours/{ours}/{policy}"], rates[f"reference/{theirs}/{policy}"]
            ratio = {
                key: own[f"{key}_per_cpu_s"] / other[f"{key}_per_cpu_s"] for key in ("median", "best")
            }
            ratio["wall"] = own["median_per_wall_s"] / other["median_per_wall_s"]
            met = None if target is None else ratio["median"] >= target
            rows.append({"case": ours, "policy": policy, **ratio, "target": target, "met": met})
    return rows


def parallel(runs):
    """8 environments on several threads over 8 on one, in wall time: the best of all rounds, and the medians."""
    find = {(run["images"], run["num_envs"], run["threads"]): run for run in runs}
    rows = []
    for (images, num_envs, threads), many in find.items():
        one = find.get((images, num_envs, 1))
        if threads == 1 or one is None:
            continue
        ratio = {key: many[f"{key}_per_wall_s"] / one[f"{key}_per_wall_s"] for key in ("median", "best")}
        met = ratio["best"] >= PARALLEL_TARGET if threads == 2 else None
        rows.append(
            {"images": images, "num_envs": num_envs, "threads": threads, **ratio}
            | {"target": PARALLEL_TARGET, "met": met}
        )
    return rows


def report(result):
    rates, lines = result["rates"], []

    def table(header, rows):
        rows = [header, *rows]
        widths = [max(len(row[column]) for row in rows) for column in range(len(header))]
        for number, row in enumerate(rows):
            cells = (
                cell.ljust(width) if column == 0 else cell.rjust(width)
                for column, (cell, width) in enumerate(zip(row, widths))
            )
            lines.append("  ".join(cells).rstrip())
            if number == 0:
                lines.append("  ".join("-" * width for width in widths))
        lines.append("")

    verdict = {True: "met", False: "MISSED", None: ""}
    lines.append("Per second of CPU time, one environment, one thread: median (best) of the rounds")
    header = ["case, policy", "reference", "here", "ratio", "of bests", "wall", "target", ""]
    rows = []
    by_case = {case: theirs for case, theirs, _ in ENVS[result["env"]]["pairs"]}
    for row in result["ratios"]:
        own = rates[f"ours/{row['case']}/{row['policy']}"]
        other = rates[f"reference/{by_case[row['case']]}/{row['policy']}"]
        rows.append(
            [f"{row['case']}, {row['policy']}"]
            + [f"{side['median_per_cpu_s']:,.0f} ({side['best_per_cpu_s']:,.0f})" for side in (other, own)]
            + [f"{row['median']:.1f}", f"{row['best']:.1f}", f"{row['wall']:.1f}"]
            + [f">= {row['target']}" if row["target"] else "", verdict[row["met"]]]
        )
    table(header, rows)
    lines.append("Whole runs by `swm bench`, steps per second of the wall, resets included: median (best)")
    table(
        ["images", "environments", "threads", "steps/s"],
        [
            [run["images"], str(run["num_envs"]), str(run["threads"])]
            + [f"{run['median_per_wall_s']:,.0f} ({run['best_per_wall_s']:,.0f})"]
            for run in result["runs"]
        ],
    )
    lines.append("8 environments, several threads over one, in wall time")
    table(
        ["images", "threads", "ratio of bests", "of medians", "target", ""],
        [
            [row["images"], str(row["threads"]), f"{row['best']:.2f}", f"{row['median']:.2f}"]
            + [f">= {row['target']}", verdict[row["met"]]]
            for row in result["parallel"]
        ],
    )
    loads = " -> ".join(f"{result[key][0]:.1f}" for key in ("load_at_start", "load_at_end"))
    lines.append(f"{result['machine']['cpu']}, {result['machine']['cores']} cores, load {loads}")
    return "\n".join(lines)


def machine():
    cpu = platform.CPU() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return {"cpu": cpu, "cores": os.cpu_count(), "system": platform.platform()}


def key_fields(key):
    images, num_envs, threads = key
    return {"images": images, "num_envs": num_envs, "threads": threads}


def add(samples, name, rate):
    samples.setdefault(name, []).append(rate)


if __name__ == "__main__":
    main()

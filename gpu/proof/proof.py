#!/usr/bin/env python3
"""Does a GPU compute what a CPU does, how fast, and how well does LeWM plan after a training at the paper's size?

    python3 proof.py parity speed train evaluate --swm ./swm --out proof [--device cuda] [--minutes 9] [--tiny]

For a machine without network: needs this folder, a command `swm` with CUDA, a CUDA toolkit or PyTorch's own, and, for the comparison,
PyTorch. Each stage ends within --minutes; `train` goes on where it stopped when it is called again. Results are lines of OUT/results.jsonl. `--tiny
--device cpu` runs all of it in minutes on a CPU, which tests this script and says nothing about a GPU.
"""

import argparse
import glob
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

FULL = {
    "preset": "paper", "image": 224, "parity_steps": 5, "parity_batch": 8, "speed_steps": 100, "speed_batch": 128,
    "steps": 24000, "batch": 128, "checkpoint": 1000, "episodes": 3000, "few": 200, "pairs": 100, "repeats": 20,
    "search": {"samples": 300, "iterations": 30, "elites": 30},
}  # fmt: skip
TINY = {
    "preset": "small", "image": 64, "parity_steps": 3, "parity_batch": 4, "speed_steps": 4, "speed_batch": 4,
    "steps": 6, "batch": 4, "checkpoint": 2, "episodes": 6, "few": 4, "pairs": 2, "repeats": 1,
    "search": {"samples": 8, "iterations": 2, "elites": 2},
}  # fmt: skip
# Losses on a GPU and a CPU, relative to each other.
TOLERANCE = 1e-3
ENV = "swm/PushT-v1"
SLOW = "expert:max_step=12"
# Exit statuses of an interrupted training that can go on.
INTERRUPTED = (75, 130)


class Proof:
    def __init__(self, options):
        self.size = TINY if options.tiny else FULL
        self.swm, self.out, self.device = str(options.swm.resolve()), options.out.resolve(), options.device
        self.end = time.monotonic()
        self.minutes = options.minutes
        self.environment = {**os.environ, **toolkit()}
        self.out.mkdir(parents=True, exist_ok=True)

    def run(self, stage):
        self.end = time.monotonic() + 60 * self.minutes
        begun = time.monotonic()
        result = {"stage": stage, "device": self.device, "tiny": self.size is TINY, **getattr(self, stage)()}
        result["seconds"] = round(time.monotonic() - begun, 1)
        line = json.dumps(result)
        with open(self.out / "results.jsonl", "a") as file:
            file.write(line + "\n")
        print(line, flush=True)
        return result.get("passed", True)

    def call(self, *words, interrupt=False):
        """Runs swm, and stops it at the end of the stage's time. With `interrupt` that is no error: None is returned."""
        command = [self.swm, *map(str, words), "--json"]
        print("$ swm", *command[1:], file=sys.stderr, flush=True)
        process = subprocess.Popen(command, stdout=subprocess.PIPE, env=self.environment, start_new_session=True)
        try:
            printed, _ = process.communicate(timeout=max(1, self.end - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGTERM)
            try:
                process.communicate(timeout=30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
            if interrupt and process.returncode in INTERRUPTED:
                return None
            raise SystemExit(f"`swm {' '.join(map(str, words))}` did not end in the stage's {self.minutes} minutes")
        finally:
            # It has a session of its own: what ends this script does not end it.
            if process.poll() is None:
                process.kill()
        if process.returncode:
            raise SystemExit(f"`swm {' '.join(map(str, words))}` failed with status {process.returncode}")
        return json.loads(printed)

    def collect(self, name, episodes, seed):
        """Episodes of the slow expert: a dataset."""
        file = self.out / name
        if not file.exists():
            size = f"{self.size['image']}x{self.size['image']}"
            part = self.out / ("part-" + name)
            part.unlink(missing_ok=True)
            self.call("collect", ENV, "--policy", SLOW, "--episodes", episodes, "--max-steps", 300, "--seed", seed, "--image-size", size,
                      "--env-option", "render=fast", "--without", "goal", "--out", part)  # fmt: skip
            part.rename(file)
        return file

    def train(self):
        """LeWM, as far as the stage's time reaches."""
        data = self.collect("slow.h5", self.size["episodes"], 102)
        run, size = self.out / "lewm", self.size
        words = ["train", "--resume", "--out", run, "--device", self.device]
        if not (run / "config.json").exists():
            words = ["train", "lewm", "--preset", size["preset"], "--dataset", data, "--out", run, "--device", self.device, "--steps", size["steps"],
                     "--batch", size["batch"], "--checkpoint-every", size["checkpoint"], "--set", "optim.lr=0.0003"]  # fmt: skip
        self.call(*words, interrupt=True)
        last = (records(run) or [{}])[-1]
        return {"steps": last.get("step", 0), "of": size["steps"], "loss": last.get("loss"), "clips_per_s": last.get("clips_per_s")}

    def evaluate(self):
        """Success of plans with the trained model, on goals of episodes that it has not seen."""
        manifest, size = self.out / "pairs.toml", f"{self.size['image']}x{self.size['image']}"
        if not manifest.exists():
            data = self.collect("pairs.h5", self.size["few"], 103)
            self.call("manifest", "make", ENV, "--dataset", data, "--tier", "historic", "--episodes", self.size["pairs"], "--goal-offset", 25,
                      "--budget", 50, "--image-size", size, "--env-option", "render=fast", "--out", manifest)  # fmt: skip
        receipt = self.call("eval", "--manifest", manifest, "--policy", self.planner(self.out / "lewm"), "--again", "--out", self.out / "result")
        summary = receipt["summary"]
        return {"success_rate": summary["success_rate"], "ci95": summary["ci95"], "pairs": self.size["pairs"]}

    def planner(self, run):
        return f"mpc:{run},device={self.device}," + ",".join(f"{name}={value}" for name, value in self.size["search"].items())

    def short(self, name, device, preset, steps, batch):
        """A few steps without dropout, whose random numbers may differ between devices: the records of the run."""
        run, data = self.out / name, self.collect("few.h5", self.size["few"], 104)
        if not (run / "config.json").exists():
            self.call("train", "lewm", "--preset", preset, "--dataset", data, "--out", run, "--device", device, "--steps", steps, "--batch", batch,
                      "--log-every", 1, "--set", "model.predictor.dropout=0")  # fmt: skip
        return records(run)

    def parity(self):
        """Losses of the first steps, on the device and on the CPU."""
        size, worst, losses = self.size, 0.0, {}
        for preset in dict.fromkeys(["small", size["preset"]]):
            pair = [[record["loss"] for record in self.short(f"parity-{preset}-{device.replace(':', '-')}-{number}", device, preset,
                                                             size["parity_steps"], size["parity_batch"])]
                    for number, device in enumerate(["cpu", self.device])]  # fmt: skip
            losses[preset] = pair
            worst = max(worst, difference(*pair))
        return {"losses": losses, "difference": worst, "wanted": TOLERANCE, "passed": worst <= TOLERANCE}

    def speed(self):
        """Seconds of a training step and of a plan, ours and PyTorch's."""
        size, run = self.size, f"speed-{self.device.replace(':', '-')}"
        steps = self.short(run, self.device, size["preset"], size["speed_steps"], size["speed_batch"])
        # The first half compiles and measures kernels.
        times = [after["elapsed_s"] - before["elapsed_s"] for before, after in zip(steps, steps[1:])]
        times = sorted(times[len(times) // 2 :])
        image = f"{size['image']}x{size['image']}"
        plans = self.call("plan", ENV, "--policy", self.planner(self.out / run), "--plan-only", "--episodes", 3, "--image-size", image)["plans"]
        ours = {"step_s": times[len(times) // 2], "plan_s": min(plan["wall_time_s"] for plan in plans), "first_plan_s": plans[0]["wall_time_s"]}
        try:
            import lewm_torch
        except ImportError as error:
            return {"ours": ours, "theirs": None, "why": f"no PyTorch: {error}"}
        search = size["search"]
        theirs = lewm_torch.measure(self.device, size["speed_batch"], size["image"], search["samples"], search["iterations"], size["repeats"])
        return {"ours": ours, "theirs": theirs, "ratio": {name: ours[name] / theirs[name] for name in ("step_s", "plan_s")}}


def records(run):
    """Of training, in the order of steps."""
    file = run / "metrics.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    return [line for line in lines if line["part"] == "train"]


def difference(ours, theirs):
    """The greatest relative difference; infinite where steps are missing or values are not finite."""
    pairs = list(zip(ours, theirs))
    if not pairs or len(ours) != len(theirs):
        return float("inf")
    worst = max(abs(a - b) / max(abs(a), 1e-12) for a, b in pairs)
    return worst if all(abs(a - b) < float("inf") for a, b in pairs) else float("inf")


def toolkit():
    """Variables for the CUDA libraries and headers that came with PyTorch, where the machine has no toolkit.

    PyTorch's packages lack the headers of nvidia-cuda-crt and nvidia-cuda-cccl, which kernels for tensor cores include."""
    found = {}
    for folder in sys.path:
        libraries = [Path(name).parent for name in glob.glob(f"{folder}/nvidia/*/lib/libnvrtc.so*")]
        headers = [Path(name).parent.parent for name in glob.glob(f"{folder}/nvidia/*/include/cuda_fp16.h")]
        if libraries and "LD_LIBRARY_PATH" not in found:
            known = os.environ.get("LD_LIBRARY_PATH", "")
            found["LD_LIBRARY_PATH"] = f"{known}:{libraries[0]}".strip(":")
        if headers and not Path("/usr/local/cuda").exists() and "CUDA_PATH" not in os.environ:
            found.setdefault("CUDA_PATH", str(headers[0]))
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stages", nargs="+", choices=["parity", "speed", "train", "evaluate"])
    parser.add_argument("--swm", type=Path, default=Path(__file__).with_name("swm"), help="the command")
    parser.add_argument("--out", type=Path, default=Path("gpu-proof"))
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--minutes", type=float, default=9.0, help="of each stage")
    parser.add_argument("--tiny", action="store_true", help="sizes for a test of this script")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    proof = Proof(options)
    passed = [proof.run(stage) for stage in options.stages]
    sys.exit(0 if all(passed) else 1)


if __name__ == "__main__":
    main()

"""What the comparisons share: a peer's virtual environment, this project's release binaries, and a process that answers
line by line. Not a program, and it knows no case that is measured. Needs only Python's standard library."""

import argparse
import hashlib
import json
import os
import statistics
import subprocess
import sys
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
# By name, version and hash; torch among them: gigabytes. Several comparisons need the same, and share the folder.
REFERENCE = ("two_room_v2", ["requirements-two-room-v2.txt"])


def folder(name):
    """Where the virtual environment `name` lies unless a user says otherwise."""
    return ROOT / ".tools/peers" / name


def environment(folder, requirements, pip_options=("--no-deps",)):
    """The Python of a virtual environment with the packages of these files; made anew when the files change."""
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    files = [HERE / name for name in requirements]
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    stamp = folder / "requirements.sha256"
    if not (python.exists() and stamp.exists() and stamp.read_text() == digest):
        if folder.exists() and not stamp.exists() and any(folder.iterdir()):
            sys.exit(f"{folder} was not made by these scripts; name another folder with --venv, or remove it")
        note(f"installing the peer into {folder}")
        venv.create(folder, clear=True, with_pip=True)
        stamp.write_text("unfinished")
        pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", *pip_options]
        for file in files:
            run([*pip, "--requirement", file])
        stamp.write_text(digest)
    return python


def build(package, name, kind="bin"):
    """Builds a release binary, or an example (`kind="example"`), and returns its path."""
    note(f"building {name}")
    run(["cargo", "build", "--release", "--quiet", "-p", package, f"--{kind}", name], cwd=ROOT)
    metadata = run(["cargo", "metadata", "--format-version", "1", "--no-deps"], cwd=ROOT, capture=True)
    target = Path(json.loads(metadata)["target_directory"]) / "release"
    return target / ("examples" if kind == "example" else "") / (name + (".exe" if os.name == "nt" else ""))


def own(command):
    """What a program of this project prints, read as JSON."""
    return json.loads(run(command, capture=True))


class Peer:
    """The process in which the peer is measured: a request per line, an answer per line, both JSON."""

    def __init__(self, python, script, *arguments, env=None):
        command = [python, "-W", "ignore", HERE / script, *arguments]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=env and {**os.environ, **env})

    def ask(self, request):
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        return self.answer()

    def answer(self):
        line = self.process.stdout.readline()
        if not line:
            sys.exit(f"the peer stopped with status {self.process.wait()}; its message stands above")
        return json.loads(line)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.process.stdin.close()
        self.process.wait()


def cases_of(envs, pairs):
    """Cases for `compare_rates`: each of `pairs` (case here, of the peer, least ratio wanted) in each environment, which the peer
    calls by its id without `swm/`."""
    named = [(env, env.removeprefix("swm/")) for env in envs]
    return [
        (f"{name} {ours}", f"{env} {ours}", f"{name} {theirs}", target)
        for env, name in named
        for ours, theirs, target in pairs
    ]


def compare_rates(doc, peer_name, place, requirements, script, envs, cases):
    """The whole program of a comparison of environments: measures the peer's `script` and our `env-rates` in turns, and prints
    ratios of medians.

    `doc`: the program's help. `place`: the name of the virtual environment. `cases`: (label, case here, of the peer,
    least ratio wanted), where a case here is an environment's id and what `env-rates` calls it, with a blank between.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=folder(place))
    parser.add_argument("--env-rates", type=Path, help="the release binary; default: built by cargo")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="CPU time per measurement")
    parser.add_argument("--check", action="store_true", help="exit with status 1 if a target is missed")
    options = parser.parse_args()
    python = environment(options.venv, requirements)
    binary = options.env_rates or build("swm-benches", "env-rates")
    rates = {}
    with Peer(python, script) as reference:
        for _ in range(options.rounds):
            for case, rate in reference.ask(options.seconds).items():
                rates.setdefault(case, []).append(rate)
            for env in envs:
                for measured in own([binary, env, options.seconds]):
                    case = f"{env} {measured['case']}"
                    rates.setdefault(case, []).append(measured["count"] / measured["cpu_s"])
    missed = report_rates(rates, cases, peer_name)
    sys.exit(1 if missed and options.check else 0)


def report_rates(rates, cases, peer_name):
    """Prints the table; returns how many targets are missed."""
    missed = 0
    wide = max(len(label) for label, *_ in cases) + 2
    print("Per second of CPU time, one environment, one thread: median of the rounds")
    print(f"{'case':{wide}}{peer_name:>12}{'here':>12}{'ratio':>9}  target")
    for label, ours, theirs, target in cases:
        here, there = statistics.median(rates[ours]), statistics.median(rates[theirs])
        missed += here / there < target
        verdict = "met" if here / there >= target else "MISSED"
        print(f"{label:{wide}}{there:12,.0f}{here:12,.0f}{here / there:9.1f}  >= {target} {verdict}")
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    return missed


def run(command, cwd=None, capture=False):
    done = subprocess.run(list(map(str, command)), cwd=cwd, stdout=subprocess.PIPE if capture else None, text=True)
    if done.returncode != 0:
        sys.exit(f"`{' '.join(map(str, command))}` stopped with status {done.returncode}")
    return done.stdout


def note(text):
    print(text, file=sys.stderr, flush=True)

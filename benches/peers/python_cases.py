"""Measures one side of python.py, in an interpreter that has the package: `ours` or `reference`.

Not started by hand: python.py starts it twice and sends one request per line, `{"case": ..., "seconds": ...}`; each answer is
one line, `{"count": ..., "cpu_s": ...}`. The cases stand in python_world.py, python_data.py and python_planning.py, each a
class with a name, targets, and `ours` and `reference`, which give a function that does some of the work and says how much.
"""

import importlib
import json
import sys
import time
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
FILES = ("python_world", "python_data", "python_planning")


class Case:
    """One thing that is measured. `ours()` and `reference()` make ready, and give a function: one piece of work -> its count."""

    name = ""
    least_ratio = None
    least_rate = None
    most_us = None

    def ours(self):
        raise NotImplementedError

    reference = None

    def describe(self):
        targets = {"least_ratio": self.least_ratio, "least_rate": self.least_rate, "most_us": self.most_us}
        return {"name": self.name, "has_reference": self.reference is not None, **targets}


def cases():
    found = {}
    for name in FILES:
        if Path(__file__).with_name(f"{name}.py").exists():
            for case in importlib.import_module(name).CASES:
                found[case.name] = case
    return found


def measure(work, seconds):
    """Counts for so many seconds of CPU time, after one piece of work that warms up."""
    work()
    count, started = 0, time.process_time()
    while (spent := time.process_time() - started) < seconds:
        count += work()
    return {"count": count, "cpu_s": spent}


def main():
    side, known = sys.argv[1], cases()
    ready = {}
    # What the packages print must not stand among the answers.
    answers, sys.stdout = sys.stdout, sys.stderr
    for line in sys.stdin:
        request = json.loads(line)
        try:
            if "list" in request:
                answer = {"cases": [case.describe() for case in known.values()]}
            else:
                name = request["case"]
                if name not in ready:
                    ready[name] = getattr(known[name], side)()
                answer = measure(ready[name], request["seconds"])
        except Exception as error:
            traceback.print_exc()
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    sys.modules["python_cases"] = sys.modules["__main__"]
    main()

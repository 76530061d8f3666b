#!/usr/bin/env python3
"""Runs Craftax-Classic here and in Craftax on JAX, as the reference wraps it, side by side.

    python3 benches/peers/craftax_classic.py [--rounds 5] [--venv FOLDER] [--check]

Installs Craftax 1.6.1 with JAX into a virtual environment of its own, builds `env-rates`, measures both in turns, and prints ratios of
medians in CPU time: steps of one environment without images.
"""

import peer

ENVS = {"swm/CraftaxClassicSymbolic-v1": "Craftax-Classic-Symbolic-v1"}

# (case here, of Craftax, least ratio wanted)
PAIRS = [("step/none", "one", 20)]

CASES = [
    (f"{env} {ours}", f"{env} {ours}", f"{name} {theirs}", target)
    for env, name in ENVS.items()
    for ours, theirs, target in PAIRS
]

if __name__ == "__main__":
    requirements, script = ["requirements-craftax-classic.txt"], "craftax_classic_reference.py"
    peer.compare_rates(__doc__, "Craftax", "craftax-classic", requirements, script, ENVS, CASES)

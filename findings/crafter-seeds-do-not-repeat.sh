#!/usr/bin/env bash
# Software:  crafter 1.8.3: `Env(seed=…)`.
# Expected:  one seed and one list of actions give one episode, however it is shown.
# Happens:   which creature goes, and what the next random numbers are used for, follows the order of a set of objects that are hashed by their
#            address: two episodes of one seed in one process differ from step 10 on. At night each image takes its noise from the numbers of
#            the game: an image more, or one of another size, makes another episode, also where objects have fixed hashes.
# Who:       users who replay actions, compare agents by seeds, or record videos of a policy beside its observations.
# Seen:      two episodes of seed 0 without an action: another state from step 10 on; with fixed hashes none, but from step 149 on with an image
#            more per step, or with images of 32 x 32 in place of 64 x 64
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages crafter==1.8.3 numpy==2.5.5
"$python" -W ignore - <<'PYTHON'
import itertools
from importlib.metadata import version

import crafter


def episode(steps, area=(64, 64), size=(64, 64), shown=False, fixed=False):
    """Of each step: places of all creatures, and health."""
    numbers = itertools.count()
    crafter.objects.Object.__hash__ = (
        (lambda self: vars(self).setdefault("number", next(numbers))) if fixed else object.__hash__
    )
    env = crafter.Env(area=area, size=size, seed=0)
    env.reset()
    found = []
    for _ in range(steps):
        _, _, _, info = env.step(0)
        if shown:
            env.render((32, 32))
        found.append((info["semantic"].tobytes(), tuple(sorted(info["inventory"].items()))))
    return found


def first_difference(one, other):
    return next((step for step, (a, b) in enumerate(zip(one, other, strict=True), 1) if a != b), None)


again = first_difference(episode(30), episode(30))
# Hashes that are the same in each episode part the two causes; a small area is made faster.
small = {"steps": 160, "area": (32, 32), "fixed": True}
base = episode(**small)
fixed = {
    "nothing else": first_difference(base, episode(**small)),
    "render() after each step": first_difference(base, episode(**small, shown=True)),
    "images of 32 x 32 in place of 64 x 64": first_difference(base, episode(**small, size=(32, 32))),
}
print(f"crafter {version('crafter')}, two episodes of seed 0 and no action, first step that differs: {again}")
print(f"with fixed hashes, by what else differs: {fixed}")
assert again is not None
nothing, *shown = fixed.values()
assert nothing is None and None not in shown
PYTHON

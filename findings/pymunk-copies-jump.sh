#!/usr/bin/env bash
# Software:  pymunk 7.3.1: `Space.copy`, `Body.copy` and pickles, of a body whose `center_of_gravity` is not its origin.
# Expected:  the copy goes on as the original does: a body at rest, without forces, stays where it is.
# Happens:   the position is restored before the center of gravity: the copy shows the right position, and the first step moves its
#            body by the distance of the two (turned by its angle). No error, no warning.
# Who:       users who save and restore simulations, or plan in copies: the T of PushT has its center of gravity 45 from its origin.
# Seen:      (256, 300) after copying, and after a step: original (256, 300), copy and pickle (256, 255)
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pymunk==7.3.1
"$python" - <<'PYTHON'
import pickle

import pymunk


def block(space):
    (body,) = space.bodies
    return tuple(round(value, 6) for value in body.position)


def step(space):
    space.step(0.01)
    return block(space)


space = pymunk.Space()
body = pymunk.Body(1, 100)
body.center_of_gravity = (0, 45)
body.position = (256, 300)
space.add(body, pymunk.Poly.create_box(body, (120, 30)))
space.step(0.01)

copies = [space.copy(), pickle.loads(pickle.dumps(space))]
repaired = space.copy()
for one in repaired.bodies:
    one.position = one.position
before = [block(one) for one in copies]
after = [step(one) for one in copies]
original, repaired = step(space), step(repaired)
print(f"pymunk {pymunk.version}: copies show {before}, and {after} after a step; the original {original}, repaired {repaired}")
assert before == [(256, 300)] * 2 and after == [(256, 255)] * 2 and original == repaired == (256, 300)
PYTHON

"""Steps an environment and renders every step with MuJoCo's own renderer, through OpenGL; for render3d.py.

    render3d_reference.py ENV SIDE FRAMES

`cheetah` and `humanoid` are those of dm_control, `cube` is OGBench's. No action moves them.
"""

import os
import sys

os.environ.setdefault("MUJOCO_GL", "egl")
# On one thread, as here: by default llvmpipe uses one per core.
os.environ["LP_NUM_THREADS"] = "0"
os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "1")

name, side, frames = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])

import numpy as np  # noqa: E402

if name == "cube":
    import gymnasium
    import ogbench.manipspace  # noqa: F401

    env = gymnasium.make("cube-single-v0", render_mode="rgb_array", width=side, height=side)
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape)
    draw = env.render
else:
    from dm_control import suite

    env = suite.load(name, {"cheetah": "run", "humanoid": "walk"}[name])
    env.reset()
    action = np.zeros(env.action_spec().shape)

    def draw():
        return env.physics.render(side, side, camera_id=0)


draw()
for _ in range(frames):
    env.step(action)
    image = np.asarray(draw())
assert image.shape == (side, side, 3) and image.std() > 0
# Contexts are torn down noisily at exit.
sys.stdout.flush()
os._exit(0)

"""Cases of python.py about worlds: steps by hand, recordings, policies in runs, the time of an import. On PushT."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from python_cases import Case

ENVS = 8
STEPS = 100
PUSHT = "swm/PushT-v1"


def random_actions():
    return np.random.default_rng(0).uniform(-1, 1, (STEPS, ENVS, 2)).astype(np.float32)


class StepCall(Case):
    """A call of `step` whose environments are over: what Python, the binding and the loop cost without a simulation."""

    name = "world/call"
    most_us = 0.6

    def ours(self):
        import stable_worldmodel_rs as swm

        world = swm.World(PUSHT, 1, add_pixels=False, threads=1, max_episode_steps=1)
        world.reset(seed=0)
        actions = np.zeros((1, 2), np.float32)
        world.step(actions)

        def work():
            for _ in range(STEPS):
                world.step(actions)
            return STEPS

        return work


class ByHand(Case):
    """Eight environments stepped by hand with random actions, no images; rates are of environments' steps."""

    name = "world/hand/bare"
    least_ratio = 200
    least_rate = 500_000

    def ours(self):
        import stable_worldmodel_rs as swm

        world = swm.World(PUSHT, ENVS, add_pixels=False, threads=1, max_episode_steps=STEPS)
        return self.loop(world, world.step)

    def reference(self):
        import stable_worldmodel as swm

        world = swm.World(PUSHT, ENVS, add_pixels=False, max_episode_steps=STEPS)
        return self.loop(world, world.envs.step)

    def loop(self, world, step):
        actions = random_actions()

        def work():
            world.reset(seed=0)
            for rows in actions:
                step(rows)
            return STEPS * ENVS

        return work


class Recorded(Case):
    """Eight environments, 64 x 64 images, the policy `weak`, recorded as HDF5; rates are of rows."""

    render = "exact"

    def ours(self):
        import stable_worldmodel_rs as swm

        world = swm.World(PUSHT, ENVS, image_shape=(64, 64), threads=1, max_episode_steps=STEPS, render=self.render)
        world.set_policy("weak")
        return self.record(world, format="hdf5")

    def reference(self):
        import stable_worldmodel as swm
        from stable_worldmodel.envs.pusht import WeakPolicy

        world = swm.World(PUSHT, ENVS, image_shape=(64, 64), max_episode_steps=STEPS)
        world.set_policy(WeakPolicy(dist_constraint=100))
        return self.record(world, format="hdf5")

    def record(self, world, **how):
        folder = tempfile.TemporaryDirectory()
        runs = iter(range(1_000_000))

        def work():
            path = Path(folder.name) / "recorded.h5"
            path.unlink(missing_ok=True)
            world.collect(path, episodes=ENVS, seed=next(runs), progress=False, **how)
            return ENVS * (STEPS + 1)

        return work


class RecordedExact(Recorded):
    name = "world/record/64/exact"
    least_ratio = 20


class RecordedFast(Recorded):
    name = "world/record/64/fast"
    render = "fast"
    least_ratio = 60


class PolicyInRun(Case):
    """One environment under a Python policy that does nothing, inside a run; a rate is of steps."""

    name = "world/policy"

    def ours(self):
        import stable_worldmodel_rs as swm

        actions = np.zeros((1, 2), np.float32)

        class Still:
            def get_action(self, infos):
                return actions

        world = swm.World(PUSHT, 1, add_pixels=False, threads=1, max_episode_steps=1000)
        world.set_policy(Still())

        def work():
            return int(world.evaluate(episodes=1, seed=0)["episode_lengths"].sum())

        return work

    def reference(self):
        import stable_worldmodel as swm

        actions = np.zeros((1, 2), np.float32)

        class Still:
            def set_env(self, envs):
                pass

            def get_action(self, infos):
                return actions

        world = swm.World(PUSHT, 1, add_pixels=False, max_episode_steps=1000)
        world.set_policy(Still())

        def work():
            world.evaluate(episodes=1, seed=0)
            return 1000

        return work


class Import(Case):
    """`import stable_worldmodel_rs` in a process of its own, without what Python itself takes to start."""

    name = "world/import"
    most_us = 150_000

    def ours(self):
        return self.imported("stable_worldmodel_rs")

    def reference(self):
        return self.imported("stable_worldmodel")

    def imported(self, name):
        code = f"import time; t = time.process_time(); import {name}; print(time.process_time() - t)"

        def work():
            done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
            # The child's CPU time is not this process's: it is spent here once more.
            until = time.process_time() + float(done.stdout.splitlines()[-1])
            while time.process_time() < until:
                pass
            return 1

        return work


CASES = [StepCall(), ByHand(), RecordedExact(), RecordedFast(), PolicyInRun(), Import()]

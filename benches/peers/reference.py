"""Measures the Python reference, inside the virtual environment that world.py makes.

Not started by hand: world.py starts it once, with the environment's id, and asks for one measurement per line, `{"case": ..., "seconds": ...}`;
each answer is one line, `{"count": steps or frames, "cpu_s": ..., "wall_s": ...}`. Resets of the step cases stand
outside of the timed region; recording resets as it goes, as it does for its users.
"""

import importlib.util
import json
import os
import sys
import tempfile
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLOSC_NTHREADS"):
    os.environ[variable] = "1"
os.environ.update(SDL_VIDEODRIVER="dummy", PYGAME_HIDE_SUPPORT_PROMPT="1", TQDM_DISABLE="1")

EPISODE_STEPS = 100

from without_torch import stand_in_for_torch  # noqa: E402

has_torch = importlib.util.find_spec("torch") is not None
if not has_torch:
    stand_in_for_torch()

import cv2  # noqa: E402
import h5py  # noqa: E402
import numpy as np  # noqa: E402
import stable_worldmodel as swm  # noqa: E402
from loguru import logger  # noqa: E402
from stable_worldmodel.envs.pusht.env import PushT  # noqa: E402
from stable_worldmodel.envs.pusht.expert_policy import WeakPolicy  # noqa: E402
from stable_worldmodel.policy import RandomPolicy  # noqa: E402

cv2.setNumThreads(1)
if has_torch:
    sys.modules["torch"].set_num_threads(1)
logger.remove()


class Clock:
    """Sums CPU time of this process and wall time over the `with` blocks."""

    def __init__(self):
        self.cpu_s = self.wall_s = 0.0

    def __enter__(self):
        self.wall_s -= time.perf_counter()
        self.cpu_s -= time.process_time()

    def __exit__(self, *error):
        self.cpu_s += time.process_time()
        self.wall_s += time.perf_counter()


def bare(policy):
    """`PushT.step` alone: physics, observation, info, reward; nothing drawn. The environment itself, unwrapped.

    The actions of an episode are found in a first run through it, which is not timed.
    """
    env, rng = PushT(), np.random.default_rng(0)

    def actions_of_episode(seed):
        env.reset(seed=seed)
        for _ in range(EPISODE_STEPS):
            action = rng.uniform(-1, 1, 2)
            if policy == "weak":  # as WeakPolicy.get_action
                agent, block = np.array(env.agent.position), np.array(env.block.position)
                target = np.clip(agent + action * env.action_scale, block - 100, block + 100)
                action = np.clip((target - agent) / env.action_scale, -1, 1)
            action = action.astype(np.float32)
            env.step(action)
            yield action

    def measure(seconds):
        clock, count = Clock(), 0
        while clock.cpu_s < seconds:
            actions = list(actions_of_episode(seed=count))
            env.reset(seed=count)
            with clock:
                for action in actions:
                    env.step(action)
            count += EPISODE_STEPS
        return count, clock

    return measure


def make_world(side, policy, limit):
    # The package's first release calls the same TwoRoom v0.
    name = {"swm/TwoRoom-v1": "swm/TwoRoom-v0"}.get(ENV_ID, ENV_ID)
    world = swm.World(name, 1, (side, side), max_episode_steps=limit, verbose=0)
    world.set_policy(WeakPolicy() if policy == "weak" else RandomPolicy(seed=0))
    return world


def world_steps(side, policy):
    """`World.step` with images: the policy, the step, the image, the info table."""
    world = make_world(side, policy, limit=10 * EPISODE_STEPS)

    def measure(seconds):
        clock, count = Clock(), 0
        while clock.cpu_s < seconds:
            world.reset(seed=count)
            with clock:
                for _ in range(EPISODE_STEPS):
                    world.step()
            count += EPISODE_STEPS
        return count, clock

    return measure


def world_resets(side, policy):
    """`World.reset` with both images."""
    world = make_world(side, policy, limit=EPISODE_STEPS)

    def measure(seconds):
        clock, count = Clock(), 0
        while clock.cpu_s < seconds:
            with clock:
                for seed in range(count, count + 10):
                    world.reset(seed=seed)
            count += 10
        return count, clock

    return measure


def record(side, policy):
    """`World.record_dataset` to HDF5, resets included: frames in the file per second."""
    world = make_world(side, policy, limit=EPISODE_STEPS)

    def measure(seconds):
        clock, count = Clock(), 0
        while clock.cpu_s < seconds:
            with tempfile.TemporaryDirectory() as folder:
                with clock:
                    world.record_dataset("peer", episodes=5, seed=count, cache_dir=folder)
                with h5py.File(os.path.join(folder, "peer.h5")) as file:
                    count += int(file["ep_len"][:].sum())
        return count, clock

    return measure


ENV_ID = sys.argv[1]
CASES = {}
for policy in ("random", "weak") if ENV_ID == "swm/PushT-v1" else ("random",):
    if ENV_ID == "swm/PushT-v1":
        CASES[f"step/bare/{policy}"] = bare(policy)
    CASES[f"reset/64/{policy}"] = world_resets(64, policy)
    CASES[f"step/64/{policy}"] = world_steps(64, policy)
    CASES[f"step/224/{policy}"] = world_steps(224, policy)
    CASES[f"record/64/{policy}"] = record(64, policy)


def main():
    # Libraries may print; answers go to the stream that world.py reads, everything else to the terminal.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    print(json.dumps({"torch": has_torch, "python": sys.version.split()[0]}), file=answers, flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        count, clock = CASES[request["case"]](request["seconds"])
        answer = {"count": count, "cpu_s": clock.cpu_s, "wall_s": clock.wall_s}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()

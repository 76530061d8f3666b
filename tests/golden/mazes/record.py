#!/usr/bin/env python3
"""Records OGBench's humanoid maze and AntSoccer: trajectories of random actions and compiled models.

    python3 tests/golden/mazes/record.py OUT

Needs the packages of benches/peers/requirements-ogb.txt and requirements-mazes.txt. Writes OGBHumanoidMaze.npz and
OGBAntSoccer.npz, several runs a file, one per maze, and the models' checksums as JSON, into the folder OUT.
"""

import json
import re
import sys
from pathlib import Path

import mujoco
import numpy as np
from ogbench.locomaze.maze import make_maze_env

SEED = 0
# Mazes and steps of a run. Humanoid and teleport do not go together in the package.
RUNS = {
    "OGBHumanoidMaze": (("humanoid", "maze"), ("medium", "large", "giant"), 40),
    "OGBAntSoccer": (("ant", "ball"), ("arena", "medium"), 60),
}
MODELS = {"humanoid-maze-medium": ("humanoid", "maze", "medium"), "ant-soccer-arena": ("ant", "ball", "arena")}


def place(env, is_ball, task):
    """Near a wall or the ball, and near the goal, so that a run has contacts, and steps at the goal and away from it."""
    env.reset(options={"task_id": task}, seed=SEED + task)
    if is_ball:
        # The ant falls onto the ball, which is pushed to the goal.
        ball = np.array(env.get_agent_ball_xy()[1])
        env.set_agent_ball_xy(ball - [0.45, 0.1], ball)
        env.set_goal(goal_xy=ball + [0.62, 0.0])
    else:
        env.set_xy(np.array(env.ij_to_xy(env.cur_task_info["init_ij"])) - [0.2 * task, 1.6])
        env.set_goal(goal_xy=env.get_xy() + [0.45, 0.1])


def record(body, maze, steps, task):
    env = make_maze_env(*body, maze_type=maze, terminate_at_goal=False)
    generator = np.random.default_rng(SEED + task)
    np.random.seed(SEED + task)
    env.action_space.seed(SEED)
    is_ball = body[1] == "ball"
    place(env, is_ball, task)
    rows = {name: [] for name in ("state_qpos", "state_qvel", "state_qacc_warmstart", "state_time", "obs")}
    ends = {name: [] for name in ("actions", "reward", "is_success", "terminated")}

    def write():
        for name in ("qpos", "qvel", "qacc_warmstart"):
            rows[f"state_{name}"].append(getattr(env.data, name).copy())
        rows["state_time"].append(env.data.time)
        rows["obs"].append(env.get_ob())

    write()
    for _ in range(steps):
        action = generator.uniform(-1, 1, env.model.nu).astype(np.float32)
        _, reward, terminated, _, info = env.step(action)
        write()
        for name, value in (("actions", action), ("reward", reward), ("is_success", info["success"]), ("terminated", terminated)):
            ends[name].append(value)
    # The goal: the last posture at the goal's place, at rest.
    goal = env.data.qpos.copy()
    goal[:2] = env.cur_goal_xy
    if is_ball:
        goal[-7:-5] = env.cur_goal_xy
    env.set_state(goal, np.zeros(env.model.nv))
    fixed = {"goal_qpos": goal, "goal_xy": np.array(env.cur_goal_xy), "goal_observation": env.get_ob()}
    arrays = {name: np.array(values) for name, values in {**rows, **ends}.items()}
    return {**arrays, **fixed}


def checksum(part):
    """FNV-1a of 64 bits."""
    value = 0xCBF29CE484222325
    for byte in part:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


# Bytes of what stands before the arrays in MuJoCo 3.17.0's binary format.
HEADER = {"sizes": 807, "option": 304, "visual": 632, "statistic": 56}


def array_names():
    """The names of a model's arrays in the order of the binary format."""
    text = (Path(mujoco.__file__).parent / "include/mujoco/mjxmacro.h").read_text().replace("\\\n", " ")
    macros = {found[1]: found[2] for found in re.finditer(r"^#define (MJMODEL_POINTERS\w*)\s(.*)$", text, re.MULTILINE)}

    def names(macro):
        for array, other in re.findall(r"\bX\w*\s*\(\s*\w+\s*,\s*(\w+)|\b(MJMODEL_POINTERS_\w+)", macros[macro]):
            yield from names(other) if other else [array]

    return names("MJMODEL_POINTERS")


def sections(model):
    """Name, bytes and checksum of each part of a model in MuJoCo's binary format."""
    data = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, data)
    arrays = {name: getattr(model, name) for name in array_names()}
    lengths = {name: len(array) if isinstance(array, bytes) else np.asarray(array).nbytes for name, array in arrays.items()}
    rest, parts = data.tobytes(), []
    for name, length in (HEADER | lengths).items():
        part, rest = rest[:length], rest[length:]
        parts.append([name, length, checksum(part)])
    assert not rest, f"{len(rest)} bytes too many"
    return parts


def main():
    out = Path(sys.argv[1])
    for name, (body, mazes, steps) in RUNS.items():
        arrays = {}
        for index, maze in enumerate(mazes):
            for key, values in record(body, maze, steps, 1 + index).items():
                arrays[f"{maze}/{key}"] = values
        meta = {"env": name, "seed": SEED, "mujoco": mujoco.__version__, "ogbench": "1.2.2"}
        arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
        np.savez_compressed(out / f"{name}.npz", **arrays)
    for name, (body, kind, maze) in MODELS.items():
        model = make_maze_env(body, kind, maze_type=maze).model
        (out / f"{name}.json").write_text(json.dumps({"sections": sections(model)}))


if __name__ == "__main__":
    main()

"""Records games of Craftax-Classic for `crates/swm-envs-2d/src/craftax_classic/tests.rs`.

Needs craftax==1.6.1 and jax[cpu]==0.10.2. The games go as the reference's wrapper (stable-worldmodel 0.1.1) plays them: keys are split
before each reset and each step. The actions of a file that exists are kept, so that a new recording answers the same ones:

    python record.py CraftaxClassic.npz

A run `name` has: `seed`, `params` (names and values of craftax's EnvParams that are not its defaults), `actions` u8 [T], `map` u8 [64, 64]
at the start, `reward` f32 [T], `terminated` u8 [T], `achievements` u32 [T + 1] (a bit each), `state` i32 [T + 1, 21], `light` f32 [T + 1] and
`digest` u64 [T + 1] of the bits of the observation without the light: d = d * 0x100000001b3 + bits, modulo 2^64, from 0.
"""

import json
import sys

import jax
import numpy as np
from craftax.craftax_classic.envs.craftax_symbolic_env import CraftaxClassicSymbolicEnvNoAutoReset

LIGHT = 1343
KINDS = ["wood", "stone", "coal", "iron", "diamond", "sapling", "wood_pickaxe", "stone_pickaxe", "iron_pickaxe"]
KINDS += ["wood_sword", "stone_sword", "iron_sword"]
FACTOR = 0x100000001B3


def digest(observation):
    bits = np.delete(observation, LIGHT).view(np.uint32).astype(np.uint64)
    powers = np.array([pow(FACTOR, len(bits) - 1 - i, 1 << 64) for i in range(len(bits))], np.uint64)
    return np.sum(bits * powers, dtype=np.uint64)


def state_of(state):
    row = [*state.player_position, state.player_direction, state.player_health, state.player_food, state.player_drink]
    row += [state.player_energy, state.is_sleeping, state.timestep]
    return np.array([int(v) for v in row] + [int(getattr(state.inventory, kind)) for kind in KINDS], np.int32)


def record(seed, changed, actions):
    env = CraftaxClassicSymbolicEnvNoAutoReset()
    params = env.default_params.replace(**changed)

    @jax.jit
    def reset(key):
        key, other = jax.random.split(key)
        return *env.reset(other, params), key

    @jax.jit
    def step(key, state, action):
        key, other = jax.random.split(key)
        return *env.step(other, state, action, params)[:4], key

    observation, state, key = reset(jax.random.PRNGKey(seed))
    run = {"seed": np.uint32(seed), "map": np.asarray(state.map, np.uint8)}
    run["params"] = np.frombuffer(json.dumps(changed).encode(), np.uint8)
    columns = {name: [] for name in ["reward", "terminated", "achievements", "state", "light", "digest"]}

    def add():
        columns["achievements"].append(sum(1 << i for i, done in enumerate(np.asarray(state.achievements)) if done))
        columns["state"].append(state_of(state))
        columns["light"].append(np.float32(observation[LIGHT]))
        columns["digest"].append(digest(np.asarray(observation, np.float32)))

    add()
    for action in actions:
        observation, state, reward, done, key = step(key, state, int(action))
        columns["reward"].append(np.float32(reward))
        columns["terminated"].append(bool(done))
        add()
        if done:
            break
    types = dict(reward="f4", terminated="u1", achievements="u4", state="i4", light="f4", digest="u8")
    run |= {name: np.array(column, types[name]) for name, column in columns.items()}
    run["actions"] = np.array(actions[: len(columns["reward"])], np.uint8)
    return run


def main(path):
    recorded = np.load(path)
    runs = sorted({name.split("/")[0] for name in recorded.files})
    out = {}
    for run in runs:
        changed = json.loads(recorded[f"{run}/params"].tobytes())
        columns = record(int(recorded[f"{run}/seed"]), changed, recorded[f"{run}/actions"])
        out |= {f"{run}/{name}": values for name, values in columns.items()}
        print(run, len(columns["reward"]), "steps, return", columns["reward"].sum(), flush=True)
    np.savez_compressed(path, **out)


if __name__ == "__main__":
    main(sys.argv[1])

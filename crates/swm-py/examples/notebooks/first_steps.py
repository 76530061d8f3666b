# %% [markdown]
# # First steps
#
# An environment, a recording, a dataset, a planner and an evaluation, in a minute on a CPU.
#
# `stable_worldmodel_rs` runs environments, recording, loading and planning in Rust. Its classes have the names of the package
# `stable-worldmodel`.
#
# No package index has the package. Where it is not installed (Colab), let `WHEEL` be the file or the address of its wheel, `stable_worldmodel_rs-*.whl`.

# %%
WHEEL = ""
if WHEEL:
    import subprocess
    import sys

    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", WHEEL], check=True)

# %%
import numpy as np
import stable_worldmodel_rs as swm

# %% [markdown]
# ## An environment
#
# A `World` steps several environments at once. What it observes is one dict of arrays, a row per environment.

# %%
world = swm.World("swm/PushT-v1", num_envs=4, image_shape=(64, 64), max_episode_steps=60)
world.reset(seed=0)
print({name: value.shape for name, value in world.infos.items() if name in ("pixels", "state", "action")})

# %% [markdown]
# In a notebook, a World shows itself as images.

# %%
world

# %% [markdown]
# ## A recording
#
# A file of exactly these episodes of this seed, whatever the number of environments.

# %%
world.set_policy("expert")
written = world.collect("pusht.h5", episodes=6, seed=1, mode="overwrite", progress=False)
print(written)

# %%
dataset = swm.data.load_dataset("pusht.h5", num_steps=4, frameskip=5, keys_to_load=["pixels", "action", "state"])
clip = dataset[0]
print({name: tuple(value.shape) for name, value in clip.items()})
dataset

# %% [markdown]
# ## A planner on a cost of your own
#
# A cost takes candidates `[b, S, H, D]` (plans of H blocks of actions) and gives costs `[b, S]`. This one moves the agent to where the goal has it.


# %%
class AgentToGoal:
    array_api = "numpy"

    def get_cost(self, infos, candidates):
        # A full action moves the agent by about 40 px.
        moves = 40 * candidates.reshape(*candidates.shape[:2], -1, 2).sum(axis=2)
        agent, goal = infos["state"][:, :, -1, :2], infos["goal_state"][:, :, -1, :2]
        return np.linalg.norm(agent + moves - goal, axis=-1)


solver = swm.planning.CEMSolver(AgentToGoal(), num_samples=64, n_steps=4, topk=8)
world.set_policy(swm.WorldModelPolicy(solver, swm.PlanConfig(horizon=5, receding_horizon=5, action_block=5)))
result = world.evaluate(episodes=4, seed=42)
result

# %% [markdown]
# The expert, on the same episodes:

# %%
world.set_policy("expert")
expert = world.evaluate(episodes=4, seed=42)
assert expert["success_rate"] >= result["success_rate"]
expert

# %% [markdown]
# # A robustness table
#
# Does a policy keep working when colors, sizes and physics change? A sweep evaluates it under each factor of variation, on the pairs of a manifest, and
# compares every change with the unchanged environment, pair by pair.
#
# No package index has the package. Where it is not installed (Colab), let `WHEEL` be the file or the address of its wheel, `stable_worldmodel_rs-*.whl`.

# %%
WHEEL = ""
if WHEEL:
    import subprocess
    import sys

    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", WHEEL], check=True)

# %%
import stable_worldmodel_rs as swm

# %% [markdown]
# ## Factors of variation

# %%
world = swm.World("swm/TwoRoom-v2", num_envs=1, image_shape=(64, 64))
print(world.envs.envs[0].variation_space.names())

# %% [markdown]
# ## The sweep
#
# The expert reads the state, so that colors cannot matter to it; the size of the door, the thickness of the wall and the agent's speed can.

# %%
swm.make_manifest("rooms.toml", "swm/TwoRoom-v2", tier="historic", episodes=8, budget=60, seed=3, overwrite=True)
sweep = swm.sweep(
    "rooms.toml", "expert", factors=["agent.color", "agent.speed", "door.size"], values="extremes", out="sweep", again=True, progress=False
)
sweep

# %% [markdown]
# ## As a table of your own

# %%
rows = [(cell["name"], str(cell["value"]), cell["summary"]) for cell in sweep["cells"]]
for name, value, summary in rows:
    rate = "–" if summary is None else "{:5.1f} % ({:.1f} to {:.1f})".format(summary["success_rate"], *summary["ci95"])
    print(f"{name:16} {value:28} {rate}")
assert len(rows) > 4 and rows[0][2]["episodes"] == 8

# %% [markdown]
# The folder `sweep` has the same as `sweep.json`, `sweep.csv` and a figure, `sweep.svg`.

# %%
from pathlib import Path

sorted(path.name for path in Path("sweep").iterdir())

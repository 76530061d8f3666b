# %% [markdown]
# # Evaluate and compare with intervals
#
# A success rate alone can be neither repeated nor compared. A *manifest* fixes starts, goals, budget and the success test; a *receipt* has the outcome of
# every pair beside those of reference policies; comparisons are pair by pair.
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
# ## A task as a file

# %%
manifest = swm.make_manifest("task.toml", "swm/TwoRoom-v2", tier="moderate", episodes=12, budget=60, seed=7, overwrite=True)
manifest

# %% [markdown]
# ## Two policies on the same pairs
#
# The first is a policy of your own: an object with `get_action`. The second is the expert with noise in its actions.


# %%
class Straight:
    """Goes straight to the goal: through the wall, if it is between."""

    def get_action(self, infos):
        toward = infos["goal_state"][:, 0, :2] - infos["state"][:, 0, :2]
        return (toward / 10).clip(-1, 1).astype("float32")


straight = swm.evaluate("task.toml", Straight(), "straight", name="straight", references=["random", "no_op"], again=True, progress=False)
straight

# %%
expert = swm.evaluate("task.toml", "noisy-expert", "expert", references=["random", "no_op"], again=True, progress=False)
expert

# %% [markdown]
# ## The difference, pair by pair
#
# An exact test and an interval of the difference; below, in what the two evaluations differ.

# %%
comparison = swm.compare(expert, straight)
assert comparison[1]["test"]["pairs"] == 12
comparison

# %% [markdown]
# ## Hand it on
#
# A bundle holds all that it takes to repeat a result, and one changed byte is found. A board shows several.

# %%
import shutil

shutil.rmtree("expert-bundle", ignore_errors=True)
print(swm.bundle("expert", "expert-bundle"))
verification = swm.verify("expert-bundle", progress=False)
assert verification["equal"]
verification["equal"], verification["summary"]

# %%
page = swm.board(["expert-bundle"], "board", title="TwoRoom, moderate tier")
page["page"]

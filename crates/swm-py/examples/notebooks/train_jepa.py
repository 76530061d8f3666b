# %% [markdown]
# # Train your own JEPA in torch
#
# A joint-embedding predictive architecture in a few lines: an encoder of images, and a predictor of the next embedding from actions. Trained on clips
# that a `Loader` reads, then used to plan from pixels. The sizes are those of a toy; `examples/train_lewm.py` has a model of published size.
#
# No package index has the package. Where it is not installed (Colab), let `WHEEL` be the file or the address of its wheel,
# `stable_worldmodel_rs-*.whl`. This notebook needs torch, too.

# %%
WHEEL = ""
if WHEEL:
    import subprocess
    import sys

    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", WHEEL], check=True)

# %%
import stable_worldmodel_rs as swm
import torch
from stable_worldmodel_rs.planning import CEMSolver, GoalMSE, ShootingCostEvaluator
from stable_worldmodel_rs.wm.loss import SIGReg
from torch import nn

BLOCK, HISTORY, DIM = 5, 3, 32  # Actions of a block, frames of a clip before the predicted one, values of an embedding.
torch.manual_seed(0)

# %% [markdown]
# ## Data
#
# Noisy experts reach most of the room. Clips have four frames, five steps apart, and all actions between them.

# %%
world = swm.World("swm/TwoRoom-v2", num_envs=4, image_shape=(32, 32), max_episode_steps=60)
world.set_policy("noisy-expert")
world.collect("rooms.h5", episodes=24, seed=0, mode="overwrite", progress=False)

clips = swm.data.load_dataset("rooms.h5", num_steps=HISTORY + 1, frameskip=BLOCK, keys_to_load=["pixels", "action"])
training, held_out = swm.data.split_held_out(clips)
loader = swm.data.Loader(training, batch_size=32, seed=0, drop_last=True)
scaler = swm.data.ZScoreScaler().fit(training.get_col_data("action"))
print(len(training), "clips to train on,", len(held_out), "held out")

# %% [markdown]
# ## The model
#
# `encode` and `rollout` are what planning asks of it; their shapes are in the documentation.


# %%
def scaled(image):
    return image.float() / 255


class Jepa(nn.Module):
    def __init__(self):
        super().__init__()
        self.encoder = nn.Sequential(
            nn.Conv2d(3, 16, 4, stride=4), nn.GELU(), nn.Conv2d(16, 32, 2, stride=2), nn.GELU(), nn.Flatten(), nn.Linear(32 * 16, DIM)
        )
        self.predictor = nn.Sequential(nn.Linear(DIM + 2 * BLOCK, 64), nn.GELU(), nn.Linear(64, DIM))

    def encode(self, x):
        images = x["pixels"]  # [B, T, 3, 32, 32]
        return {**x, "emb": self.encoder(images.flatten(0, 1)).unflatten(0, images.shape[:2])}

    def predict(self, emb, block):
        return emb + self.predictor(torch.cat([emb, block], dim=-1))

    def rollout(self, info, candidates):  # [B, S, H, D]
        seen = self.encode({"pixels": info["pixels"][:, 0]})["emb"]
        embs = list(seen[:, None].expand(-1, candidates.shape[1], -1, -1).unbind(2))
        for block in candidates.unbind(2):
            embs.append(self.predict(embs[-1], block))
        info["predicted_emb"] = torch.stack(embs, dim=2)
        return info


# %% [markdown]
# ## Training
#
# The error of the predicted embedding, and SIGReg, without which all embeddings would become one. Metrics go to `run/metrics.jsonl`; `to="trackio"`
# (or wandb, mlflow, tensorboard) hands them to a tracker as well.

# %%
model, sigreg = Jepa(), SIGReg()
optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3)
tracker = swm.track.start(None, "run", config={"dim": DIM, "block": BLOCK})
losses = []
for epoch in range(3):
    for batch in loader:
        embs = model.encode({"pixels": scaled(batch["pixels"])})["emb"]
        blocks = scaler.transform(batch["action"].unflatten(-1, (BLOCK, -1))).flatten(-2).nan_to_num()
        error = nn.functional.mse_loss(model.predict(embs[:, :HISTORY], blocks[:, :HISTORY]), embs[:, 1:])
        loss = error + 0.1 * sigreg(embs.transpose(0, 1))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
        tracker.log({"loss": loss, "error": error})
print(f"{len(losses)} steps, loss {losses[0]:.3f} to {losses[-1]:.3f}")
assert losses[-1] < losses[0]

# %% [markdown]
# ## Planning from pixels

# %%
cost = ShootingCostEvaluator(model.eval().requires_grad_(False), GoalMSE())
solver = CEMSolver(cost, batch_size=4, num_samples=32, n_steps=3, topk=4)
plan = swm.PlanConfig(horizon=4, receding_horizon=2, action_block=BLOCK)
world.set_policy(swm.WorldModelPolicy(solver, plan, process={"action": scaler}, transform={"pixels": scaled}))
result = world.evaluate(episodes=4, seed=1, tracker=tracker)
tracker.finish()
result

# %% [markdown]
# What was tracked, the evaluation with its interval included:

# %%
swm.track.read("run")[-1]

#!/usr/bin/env bash
# Software:  lightning 2.6.6: the callback `EMAWeightAveraging`.
# Expected:  before `update_starting_at_step`, validation, checkpoints and the final model are the model that is trained; with
#            `update_starting_at_epoch` alone, averaging begins at that epoch.
# Happens:   until the first update, the average is the model before training, and takes the place of the trained one in validation, in
#            `state_dict` of checkpoints and after training. `update_starting_at_epoch` alone delays nothing, and adds an update per epoch.
#            (The manual has that the average takes the model's place, and not what it is before the first update.)
# Who:       users who begin an EMA after a warm-up that is longer than the training, or keep the best checkpoint from before it.
# Seen:      a weight that goes from 0 to 1 in 15 steps: with a start at step 20, it is 0.0 after training, and in the checkpoint
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages lightning==2.6.6 torch==2.15.0
cat >"$folder/average.py" <<'PYTHON'
import logging

import lightning
import torch
from lightning.pytorch.callbacks import EMAWeightAveraging
from torch.utils.data import DataLoader


class ToOne(lightning.LightningModule):
    def __init__(self):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(()))
        self.validated = []

    def training_step(self, batch, index):
        return (self.weight - 1) ** 2

    def validation_step(self, batch, index):
        self.validated.append(round(self.weight.item(), 3))

    def on_train_batch_end(self, outputs, batch, index):
        self.trained = round(self.weight.item(), 3)

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), 0.2)


def train(epochs=3, **start):
    model = ToOne()
    trainer = lightning.Trainer(
        accelerator="cpu",
        max_epochs=epochs,
        callbacks=[EMAWeightAveraging(**start)],
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        default_root_dir=".",
    )
    five = DataLoader(torch.zeros(5, 1))
    saved = []
    model.on_validation_end = lambda: saved.append(checkpoint_weight(trainer))
    trainer.fit(model, five, five)
    return model.trained, model.validated[::5], saved, round(model.weight.item(), 3)


def checkpoint_weight(trainer):
    trainer.save_checkpoint("one.ckpt")
    return round(torch.load("one.ckpt", weights_only=True)["state_dict"]["weight"].item(), 3)


at_step, at_epoch, at_once = train(update_starting_at_step=20), train(update_starting_at_epoch=2), train()
print(f"lightning {lightning.__version__}: the weight after 15 steps {at_step[0]}")
print(f"from step 20: validated {at_step[1]}, saved {at_step[2]}, after training {at_step[3]}")
print(f"from epoch 2: validated {at_epoch[1]}; without a start: validated {at_once[1]}")
assert at_step == (1, [0, 0, 0], [0, 0, 0], 0) and at_epoch[1][0] == at_once[1][0] > 0
PYTHON
cd "$folder"
HOME=$folder "$python" -W ignore average.py 2>errors | grep -a "^lightning\|^from" || { cat errors >&2; exit 1; }

#!/usr/bin/env bash
# Software:  torch 2.15.0 on the CPU: `nn.TransformerEncoderLayer` with `src_key_padding_mask`, one sequence of which is all padding.
# Expected:  the same output, but for dropout (0 here), in training and evaluation.
# Happens:   training, and evaluation with gradients, give finite values; evaluation under `no_grad` takes another path, which gives
#            NaN for that sequence. A mean over the batch is NaN.
# Who:       users whose model has no NaN while it trains, and whose validation or planning is NaN: a missing camera or history.
# Seen:      NaN in the empty and the other sequence: train [False, False], eval [False, False], eval without gradients [True, False]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torch==2.15.0 numpy==2.4.6
"$python" -W ignore - <<'PYTHON'
import torch

torch.manual_seed(0)
layer = torch.nn.TransformerEncoderLayer(16, 2, 32, dropout=0.0, batch_first=True)
tokens = torch.randn(2, 5, 16)
padding = torch.tensor([[True] * 5, [False] * 4 + [True]])
found = {}
for name, training, gradients in (("train", True, True), ("eval", False, True), ("eval without gradients", False, False)):
    layer.train(training)
    with torch.set_grad_enabled(gradients):
        found[name] = layer(tokens, src_key_padding_mask=padding).isnan().flatten(1).any(1).tolist()
print(f"torch {torch.__version__}: NaN in the empty and the other sequence: {found}")
assert found == {"train": [False, False], "eval": [False, False], "eval without gradients": [True, False]}
PYTHON

#!/usr/bin/env bash
# Software:  torch 2.15.0 (`torch.onnx.export`) with onnx 1.23.2, onnxscript 0.7.2 and onnxruntime 1.32.0.
# Expected:  a copy of `policy.onnx` is a copy of the model, or an error where the weights are not beside it under its own name.
# Happens:   weights are in `policy.onnx.data`, also those of 16 kB, and the copy goes on to name that file: once the next checkpoint is
#            exported as `policy.onnx`, the copy runs with the weights of that checkpoint. No error, no warning.
# Who:       users who export under one name during training and keep the best model by copying or renaming it.
# Seen:      weights 1: 64.0; its copy after weights 2 were exported: 128.0; with external_data=False: 64.0
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages torch==2.15.0 onnx==1.23.2 onnxscript==0.7.2 onnxruntime==1.32.0 numpy==2.4.6
"$python" -W ignore - "$folder" <<'PYTHON'
import os
import shutil
import sys

import onnxruntime
import torch

os.chdir(sys.argv[1])


def export(weight, **options):
    model = torch.nn.Linear(64, 64, bias=False).eval()
    torch.nn.init.constant_(model.weight, weight)
    torch.onnx.export(model, (torch.ones(1, 64),), "policy.onnx", verbose=False, **options)


def run(path):
    session = onnxruntime.InferenceSession(path)
    values = session.run(None, {session.get_inputs()[0].name: torch.ones(1, 64).numpy()})
    return float(values[0][0, 0])


found = {}
for name, options in {"as it comes": {}, "external_data=False": {"external_data": False}}.items():
    export(1.0, **options)
    files = {file: os.path.getsize(file) for file in ("policy.onnx", "policy.onnx.data") if os.path.exists(file)}
    before = run("policy.onnx")
    shutil.copy("policy.onnx", "best.onnx")
    export(2.0, **options)
    found[name] = before, run("best.onnx"), files
    for file in files:
        os.remove(file)
print(f"torch {torch.__version__}, onnxruntime {onnxruntime.__version__}: before, copy after the next export: {found}")
assert found["as it comes"][:2] == (64.0, 128.0) and len(found["as it comes"][2]) == 2
assert found["external_data=False"][:2] == (64.0, 64.0) and len(found["external_data=False"][2]) == 1
PYTHON

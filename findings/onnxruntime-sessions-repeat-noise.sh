#!/usr/bin/env bash
# Software:  onnxruntime 1.32.0 on a CPU: models with RandomNormal, RandomNormalLike, RandomUniform, Multinomial without a seed.
# Expected:  each session has random numbers of its own, as two models of torch in one process have.
# Happens:   all sessions of a process begin with the same seed: each gives the same numbers at its first run, the same at its
#            second. Another process has others.
# Who:       users who run a stochastic policy or world model in several sessions (one per environment or thread, an ensemble): their
#            samples are one sample, and its spread seems to be zero.
# Seen:      first numbers of three sessions: 1 different; of two processes: 2 different; of runs of one session: 3 different
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages onnxruntime==1.32.0 onnx==1.23.2 numpy==2.4.6
cat >"$folder/noise.py" <<'PYTHON'
import subprocess
import sys

import onnx
import onnxruntime
from onnx import TensorProto, helper

logits = helper.make_tensor("logits", TensorProto.FLOAT, [1, 4], [0.0] * 4)
nodes = [
    helper.make_node("RandomNormal", [], ["normal"], shape=[4]),
    helper.make_node("RandomUniform", [], ["uniform"], shape=[4]),
    helper.make_node("RandomNormalLike", ["logits"], ["like"]),
    helper.make_node("Multinomial", ["logits"], ["actions"], sample_size=32),
]
outputs = [helper.make_tensor_value_info(node.output[0], TensorProto.FLOAT, None) for node in nodes[:3]]
outputs.append(helper.make_tensor_value_info("actions", TensorProto.INT32, None))
graph = helper.make_graph(nodes, "noise", [], outputs, [logits])
model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 21)], ir_version=10).SerializeToString()


def runs():
    session = onnxruntime.InferenceSession(model)
    return [tuple(tuple(part.flatten().tolist()) for part in session.run(None, {})) for _ in range(3)]


sessions = [runs() for _ in range(3)]
if len(sys.argv) > 1:
    print(hash(sessions[0][0]))
    raise SystemExit
other = int(subprocess.run([sys.executable, __file__, "other"], check=True, capture_output=True, text=True).stdout)
different = {
    "first runs of three sessions": len({session[0] for session in sessions}),
    "second runs of three sessions": len({session[1] for session in sessions}),
    "runs of one session": len(set(sessions[0])),
    "first runs of two processes": len({other, hash(sessions[0][0])}),
}
print(f"onnxruntime {onnxruntime.__version__}: different numbers: {different}; normal {[round(x, 2) for x in sessions[0][0][0]]}")
assert list(different.values()) == [1, 1, 3, 2]
PYTHON
"$python" -W ignore "$folder/noise.py"

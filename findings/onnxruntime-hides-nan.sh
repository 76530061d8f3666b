#!/usr/bin/env bash
# Software:  onnxruntime 1.32.0 on the CPU: ReduceMax and ReduceMin.
# Expected:  NaN where a value is NaN, as in PyTorch and NumPy.
# Happens:   a NaN in the first place gives NaN, one in another place is passed over.
# Who:       users of `--policy onnx:DIR` whose model ends in a maximum or minimum: a broken model gets finite costs.
# Seen:      NaN in place 0, 1, 2, 3: ReduceMax nan 2.0 3.0 2.0; ReduceMin nan 0.0 0.0 0.0; ReduceSum nan nan nan nan
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages onnxruntime==1.32.0 onnx==1.23.2 numpy==2.4.6
"$python" - <<'PYTHON'
import numpy as np
import onnxruntime
from onnx import TensorProto, helper

found = {}
for operator in ("ReduceMax", "ReduceMin", "ReduceSum"):
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, [4])
    y = helper.make_tensor_value_info("y", TensorProto.FLOAT, [])
    graph = helper.make_graph([helper.make_node(operator, ["x"], ["y"], keepdims=0)], "g", [x], [y])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    values = np.arange(4, dtype=np.float32)
    found[operator] = [float(session.run(None, {"x": np.where(values == place, np.nan, values)})[0]) for place in range(4)]
print(f"onnxruntime {onnxruntime.__version__}, NaN in place 0, 1, 2, 3:", found)
hidden = [False, True, True, True]
assert np.isfinite(found["ReduceMax"]).tolist() == np.isfinite(found["ReduceMin"]).tolist() == hidden
assert np.isnan(found["ReduceSum"]).all()
PYTHON

"""Writes small models by hand whose outputs have many shapes and types, for the tests of swm-onnx: a point that moves by its actions
times 5; cost: squared distance from the goal. Needs onnx. Usage: make_outputs.py crates/swm-onnx/tests/outputs"""

import sys
from pathlib import Path

import onnx
from onnx import TensorProto, helper

S, H, D = 32, 5, 10
FOLDER = Path(sys.argv[1])
NODE = helper.make_node
LATENTS = {"start": [1, 2], "target": [1, 2]}


def constant(name, values, kind=TensorProto.INT64, shape=None):
    return helper.make_tensor(name, kind, [len(values)] if shape is None else shape, values)


def save(name, nodes, inputs, outputs, constants):
    def infos(values):
        return [helper.make_tensor_value_info(key, kind, shape) for key, (kind, shape) in values.items()]

    graph = helper.make_graph(nodes, name, infos(inputs), infos(outputs), initializer=constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10, producer_name="")
    onnx.checker.check_model(model)
    onnx.save(model, FOLDER / f"{name}.onnx")


def floats(shapes):
    return {name: (TensorProto.FLOAT, shape) for name, shape in shapes.items()}


def cost(name, tail, shape, kind=TensorProto.FLOAT, samples=S, more=None, constants=()):
    """A cost whose last nodes are `tail`, from `sums` [S], `columns` [S, 1] and `off` [S, 2]."""
    nodes = [
        NODE("Reshape", ["actions", "steps_shape"], ["steps"]),
        NODE("ReduceSum", ["steps", "axis"], ["sum"], keepdims=0),
        NODE("Mul", ["sum", "speed"], ["moved"]),
        NODE("Add", ["start", "moved"], ["end"]),
        NODE("Sub", ["end", "target"], ["off"]),
        NODE("ReduceSumSquare", ["off", "axis"], ["sums"], keepdims=0),
        NODE("ReduceSumSquare", ["off", "axis"], ["columns"], keepdims=1),
        *tail,
    ]
    known = [
        constant("steps_shape", [-1, H * D // 2, 2]),
        constant("axis", [1]),
        constant("first_axis", [0]),
        constant("speed", [5.0], TensorProto.FLOAT, []),
        constant("s_h", [S, H]),
        *constants,
    ]
    used = {name for node in nodes for name in node.input}
    outputs = {"cost": (kind, shape), **(more or {})}
    inputs = floats({"actions": [samples, H, D], **LATENTS})
    save(name, nodes, inputs, outputs, [value for value in known if value.name in used])


def gradient(name, shape, kind=TensorProto.FLOAT):
    """As above, with the derivative of `cost`: ten times `off` for each action."""
    wanted = constant("wanted", shape)
    constants = [constant("s_1_2", [S, 1, 2]), constant("s_25_2", [S, H * D // 2, 2]), wanted]
    constants.append(constant("ten", [10.0], TensorProto.FLOAT, []))
    tail = [
        NODE("Cast", ["sums"], ["cost"], to=TensorProto.FLOAT),
        NODE("Mul", ["off", "ten"], ["slope"]),
        NODE("Reshape", ["slope", "s_1_2"], ["one"]),
        NODE("Expand", ["one", "s_25_2"], ["all"]),
        NODE("Reshape", ["all", "wanted"], ["flat"]),
        NODE("Cast", ["flat"], ["gradient"], to=kind),
    ]
    cost(name, tail, [S], more={"gradient": (kind, shape)}, constants=constants)


def encode(name, nodes, constants=(), latents=LATENTS):
    save(name, nodes, floats({"state": [1, 2], "goal_state": [1, 2]}), floats(latents), list(constants))


FOLDER.mkdir(exist_ok=True)
target = NODE("Identity", ["goal_state"], ["target"])
encode("encode", [NODE("Identity", ["state"], ["start"]), target])
encode("encode_start", [NODE("Identity", ["state"], ["start"])], latents={"start": [1, 2]})
# 0 / 0 in the second place.
late = constant("late", [1.0, 0.0], TensorProto.FLOAT)
encode("encode_nan", [NODE("Mul", ["state", "late"], ["some"]), NODE("Div", ["some", "late"], ["start"]), target], [late])

same = [NODE("Identity", ["sums"], ["cost"])]
mean = NODE("ReduceMean", ["sums", "first_axis"], ["cost"], keepdims=1)
scalar = NODE("ReduceMean", ["sums", "first_axis"], ["cost"], keepdims=0)
cost("s", same, [S])
cost("s_1", [NODE("Identity", ["columns"], ["cost"])], [S, 1])
cost("f64", [NODE("Cast", ["sums"], ["cost"], to=TensorProto.DOUBLE)], [S], TensorProto.DOUBLE)
cost("open", same, ["S"], samples="S")
cost("one", [mean], [1])
cost("scalar", [scalar], [])
cost("s_h", [NODE("Expand", ["columns", "s_h"], ["cost"])], [S, H])
cost("i32", [NODE("Cast", ["sums"], ["cost"], to=TensorProto.INT32)], [S], TensorProto.INT32)
# States no size, and gives one value.
cost("unstated", [mean], ["n"], samples="S")
nan = constant("weight", [1.0, float("nan")], TensorProto.FLOAT)
cost("nan", [NODE("Mul", ["off", "weight"], ["bad"]), NODE("ReduceMax", ["bad", "axis"], ["cost"], keepdims=0)], [S], constants=[nan])
gradient("grad", [S, H, D])
gradient("grad_f64", [S, H, D], TensorProto.DOUBLE)
gradient("grad_flat", [S, H * D])

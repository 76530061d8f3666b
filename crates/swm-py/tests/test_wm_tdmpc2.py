"""TD-MPC2 as a torch module: equal to what the reference computes with the same weights, in files, and in plans."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import stable_worldmodel_rs as swm  # noqa: E402
import tdmpc2_golden as golden  # noqa: E402
from stable_worldmodel_rs import wm  # noqa: E402
from stable_worldmodel_rs.planning import CEMSolver  # noqa: E402
from stable_worldmodel_rs.wm import tdmpc2  # noqa: E402
from test_wm import GOLDEN, expected, many, near  # noqa: E402

STATE = GOLDEN / "tdmpc2_state"


def generated() -> Any:
    """The model of images with its generated weights."""
    model = wm.TDMPC2(golden.CONFIG["cfg"]).eval()
    shapes = {name: tuple(value.shape) for name, value in model.state_dict().items()}
    model.load_state_dict({name: torch.from_numpy(value) for name, value in golden.weights(shapes).items()})
    return model


def test_a_published_file_equals_the_reference() -> None:
    model, data = wm.load_pretrained(STATE), expected("tdmpc2_state")
    assert isinstance(model, wm.TDMPC2) and not model.training
    with torch.no_grad():
        latents = model.encode({"state": data["state"]})
        near(latents, data["latents"])
        near(torch.tanh(model.pi(latents).chunk(2, dim=-1)[0]), data["prior"])
        now = latents[:1].expand(4, -1)
        for step in range(3):
            now, _ = model(now, data["candidates"][:, step])
            near(now, data["rollout"][:, step])
        # As the reference has infos, as solvers have them, and with several frames.
        for state in (data["state"][:1], many(data["state"][0]), many(data["state"][:1]), many(torch.stack([data["state"][1], data["state"][0]]))):
            cost = model.get_cost({"state": state}, data["candidates"][None])
            near(cost[0], data["cost"])
            assert cost[0].argmin() == data["cost"].argmin()


def test_a_model_of_images_and_its_losses_equal_the_reference() -> None:
    model = generated()
    wanted = json.loads((GOLDEN / "tdmpc2_pixels" / "expected.json").read_text())
    assert sorted(model.state_dict()) == wanted.pop("names")
    found = golden.outputs(model, tdmpc2.tdmpc2_forward, golden.CONFIG["cfg"])
    assert set(found) == set(wanted)
    for name, stored in wanted.items():
        near(torch.from_numpy(np.asarray(found[name])), torch.tensor(stored["values"]).reshape(stored["shape"]), 1e-5 if name != "gradients" else 1e-4)


def test_images_of_bytes_are_normalized_and_resized() -> None:
    model, data = generated(), golden.inputs()
    wanted = json.loads((GOLDEN / "tdmpc2_pixels" / "expected.json").read_text())["latents"]
    pixels, state = torch.from_numpy(data["pixels"]), torch.from_numpy(data["state"])
    with torch.no_grad():
        for images in (pixels, pixels.movedim(-1, -3)):
            near(model.encode({"pixels": images, "state": state}), torch.tensor(wanted["values"]).reshape(wanted["shape"]))
        larger = torch.nn.functional.interpolate(pixels.movedim(-1, -3).float(), size=(80, 80)).byte()
        assert model.encode({"pixels": larger, "state": state}).shape == (2, 24)
        assert model.encode({"pixels": pixels[:, None].expand(-1, 3, -1, -1, -1), "state": state[:, None].expand(-1, 3, -1)}).shape == (2, 3, 24)


def test_candidates_share_an_encoding() -> None:
    model, data = generated(), golden.inputs()
    infos = {"pixels": torch.from_numpy(data["pixels"][:1])[:, None, None], "state": torch.from_numpy(data["state"][:1])[:, None, None]}
    expanded = {key: value.expand(1, 4, *value.shape[2:]) for key, value in infos.items()}
    copied = {key: value.contiguous() for key, value in expanded.items()}
    candidates = torch.from_numpy(data["candidates"])[None]
    seen: list[Any] = []
    model.cnn.register_forward_hook(lambda _, inputs, __: seen.append(len(inputs[0])))
    with torch.no_grad():
        near(model.get_cost(expanded, candidates), model.get_cost(copied, candidates))
    assert seen == [1, 4]


def test_what_is_saved_is_loaded_again(tmp_path: Path) -> None:
    model, data = wm.load_pretrained(STATE), expected("tdmpc2_state")
    config = json.loads((STATE / "config.json").read_text())
    wm.save_pretrained(model, tmp_path / "a", config)
    stored, given = (torch.load(path, weights_only=True) for path in (tmp_path / "a" / "weights.pt", STATE / "weights_epoch_1.pt"))
    assert set(stored) == set(given) and all(torch.equal(stored[name], given[name]) for name in given)
    again = wm.load_pretrained(tmp_path / "a")
    with torch.no_grad():
        near(again.get_cost({"state": data["state"][:1]}, data["candidates"][None])[0], data["cost"])
    # A Lightning checkpoint, and the model of images.
    shutil.copy(STATE / "config.json", tmp_path / "config.json")
    torch.save({"state_dict": {f"model.{name}": value for name, value in given.items()}, "epoch": 1}, tmp_path / "last.ckpt")
    assert torch.equal(wm.load_pretrained(tmp_path / "last.ckpt").scale.value, given["scale.value"])
    wm.save_pretrained(generated(), tmp_path / "b", golden.CONFIG)
    assert torch.equal(wm.load_pretrained(tmp_path / "b").cnn[0].weight, generated().cnn[0].weight)


BAD: list[tuple[str, Any, str]] = [
    ("wm.num_bins", None, "cfg.wm.num_bins is None; give a whole number"),
    ("wm.num_q", 0, "cfg.wm.num_q is 0; give a whole number from 1"),
    ("wm.mlp_dim", "16", "cfg.wm.mlp_dim is '16'"),
    ("wm.encoding", {}, "cfg.wm.encoding names no column"),
    ("wm.encoding", ["state"], "cfg.wm.encoding is .*; give the dims of latents by column"),
    ("wm.encoding", {"state": 12}, "latents of 12 values are no multiple of simnorm_dim, 8"),
    ("wm.encoding", {"pixels": 16}, "cfg.image_size is 20; the convolutions need 40 or more"),
    ("extra_dims", {}, "cfg has no extra_dims.state"),
    ("action_dim", True, "cfg.action_dim is True"),
    ("wm.mlp_dim", 24, "shapes: dynamics.0.weight"),
]


@pytest.mark.parametrize(("path", "value", "message"), BAD)
def test_bad_settings_are_named(path: str, value: Any, message: str, tmp_path: Path) -> None:
    config = copy.deepcopy(json.loads((STATE / "config.json").read_text()))
    config["cfg"]["image_size"] = 20
    node: Any = config["cfg"]
    *above, last = path.split(".")
    for name in above:
        node = node[name]
    node[last] = value
    shutil.copy(STATE / "weights_epoch_1.pt", tmp_path)
    (tmp_path / "config.json").write_text(json.dumps(config))
    with pytest.raises(ValueError, match=message):
        wm.load_pretrained(tmp_path)


def test_wrong_columns_and_actions_are_named() -> None:
    model, data = generated(), golden.inputs()
    pixels, state = torch.from_numpy(data["pixels"]), torch.from_numpy(data["state"])
    candidates = torch.zeros(2, 4, 3, 2)
    for infos, message in [
        ({"pixels": pixels}, "the model encodes pixels, state, and 'state' is not there; there are pixels"),
        ({"pixels": pixels, "state": state[:, :3]}, r"state: \[2, 3\], rows of 3 values; the model takes 6, cfg.extra_dims.state"),
        ({"pixels": torch.zeros(2, 3, 32, 32), "state": state}, r"pixels: images \[3, 32, 32\]; the model takes \[3, 40, 40\]"),
    ]:
        with pytest.raises(ValueError, match=message):
            model.encode(infos)
    with pytest.raises(ValueError, match=r"candidates \[B, S, H, A\] = \[2, 4, 3, 4\], blocks of 4 values; the model takes 2, .*action_block=1"):
        model.get_cost({"pixels": pixels, "state": state}, candidates.repeat(1, 1, 1, 2))
    wide, now = torch.zeros(2, 4), {"pixels": pixels[:, None], "state": state[:, None]}
    wrongs: list[Callable[[], Any]] = [
        lambda: model(model.encode({"pixels": pixels, "state": state}), wide),
        lambda: model.get_action(now, 2, prefix_actions=wide[:, None]),
    ]
    for wrong in wrongs:
        with pytest.raises(ValueError, match=r"actions \[2, 4\], of 4 values each; the model takes 2, cfg.action_dim"):
            wrong()


@pytest.mark.parametrize("num_envs", [1, 3])
def test_it_plans_and_its_own_actions_begin_the_search(num_envs: int) -> None:
    cfg = copy.deepcopy(golden.CONFIG["cfg"])
    cfg["wm"]["encoding"], cfg["extra_dims"]["state"] = {"state": 16}, 7
    model = wm.TDMPC2(cfg).eval()
    world = swm.World("swm/PushT-v1", num_envs=num_envs, image_shape=(32, 32), max_episode_steps=4, threads=1)
    solver = CEMSolver(model, num_samples=8, n_steps=2, topk=2)
    world.set_policy(swm.WorldModelPolicy(solver, swm.PlanConfig(horizon=3, receding_horizon=1)))
    torch.manual_seed(0)
    assert world.evaluate(episodes=3, seed=0, progress=False)["episodes"] == 3
    solver = CEMSolver(model, num_samples=8, n_steps=2, topk=2)
    with pytest.raises(ValueError, match="action_block=1"):
        world.set_policy(swm.WorldModelPolicy(solver, swm.PlanConfig(horizon=3, receding_horizon=1, action_block=2)))
        world.evaluate(episodes=1, seed=0, progress=False)


def test_two_hot_is_undone() -> None:
    cfg = {"wm": {"num_bins": 51, "vmin": -6, "vmax": 2}}
    values = torch.tensor([-3.0, -0.2, 0.0, 0.7, 5.0])
    weights = tdmpc2.two_hot(values, cfg)
    assert weights.shape == (5, 51) and torch.allclose(weights.sum(-1), torch.ones(5))
    assert int((weights > 0).sum(-1).max()) <= 2
    # Logits of these weights are the mean of the bins, which is exact in the units of symlog.
    near(tdmpc2.two_hot_inv(weights.clamp_min(1e-30).log(), cfg)[:, 0], values, 1e-5)


def test_it_serves_under_the_references_name(run_python: Any) -> None:
    code = """from stable_worldmodel_rs import compat; compat.install()
from stable_worldmodel.wm.tdmpc2 import TDMPC2, RunningScale, tdmpc2_forward
from stable_worldmodel.wm.tdmpc2.module import two_hot_inv
import stable_worldmodel_rs as ours
print(TDMPC2 is ours.wm.TDMPC2, tdmpc2_forward.__module__)"""
    done = run_python(code)
    assert done.stdout.split() == ["True", "stable_worldmodel_rs.wm.tdmpc2.loss"], done.stderr

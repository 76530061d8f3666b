"""Torch modules of published checkpoints: equal to what the reference computes with the same files."""

from __future__ import annotations

import copy
import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from stable_worldmodel_rs import wm  # noqa: E402
from stable_worldmodel_rs.wm._images import normalized  # noqa: E402
from stable_worldmodel_rs.wm._weights import read_weights  # noqa: E402

GOLDEN = Path(__file__).resolve().parents[3] / "tests" / "golden" / "checkpoints"
JOINT = ["lewm_transformers4/weights.pt", "lewm_trainer/last.ckpt", "pldm/weights_epoch_1.pt"]
HEADS = {"encoder.heads": 3}


def expected(folder: str) -> dict[str, Any]:
    """Inputs and outputs, as they are stored: bytes of images are not made floats."""
    from stable_worldmodel_rs.wm import _weights

    return _weights._safetensors(GOLDEN / folder / "expected.safetensors")


def near(found: Any, wanted: Any, bound: float = 1e-5) -> None:
    found, wanted = found.detach().double().numpy(), wanted.double().numpy()
    assert found.shape == wanted.shape
    worst = np.max(np.abs(found - wanted) / (1 + np.abs(wanted)))
    assert worst <= bound, worst


def many(tensor: Any, count: int = 4) -> Any:
    return tensor[None, None].expand(1, count, *tensor.shape)


def joint_agrees(model: Any, data: dict[str, Any], bound: float = 1e-5) -> None:
    with torch.no_grad():
        near(model.encode({"pixels": data["pixels"][:, None]})["emb"][:, 0], data["embeddings"], bound)
        near(model.encode(data["pixels"]), data["embeddings"], bound)
        near(model.action_encoder(data["candidates"]), data["action_embeddings"], bound)
        goal = many(data["pixels"][1:])
        info = {"pixels": many(data["pixels"][:1]), "goal": goal}
        cost = model.get_cost(info, data["candidates"][None])
        near(cost[0], data["cost"], bound)
        assert cost[0].argmin() == data["cost"].argmin()
        near(info["predicted_emb"][0, :, 1:], data["rollout"], bound)
        # All of the history: blocks between frames, before the candidates or beside them.
        past, actions = data["past_pixels"], many(data["past_actions"])
        info = {"pixels": many(past), "goal": goal}
        near(model.get_cost(info, torch.cat([actions, data["candidates"][None]], dim=2))[0], data["past_cost"], bound)
        near(info["predicted_emb"][0, :, len(past) :], data["past_rollout"], bound)
        info = {"pixels": many(past), "goal": goal, "action_history": actions}
        near(model.get_cost(info, data["candidates"][None])[0], data["past_cost"], bound)


@pytest.mark.parametrize("file", JOINT)
def test_joint_models_equal_the_reference(file: str) -> None:
    model = wm.load_pretrained(GOLDEN / file)
    assert not model.training
    joint_agrees(model, expected(file.split("/")[0]))


def test_half_precision_is_read() -> None:
    # Weights were rounded to 11 bits, which two steps of a rollout amplify.
    joint_agrees(wm.load_pretrained(GOLDEN / "lewm_transformers5" / "half.pt"), expected("lewm_transformers5"), 2e-2)


def test_prejepa_equals_the_reference() -> None:
    model, data = wm.load_pretrained(GOLDEN / "prejepa"), expected("prejepa")
    pixels, proprio = data["pixels"], data["proprio"]
    with torch.no_grad():
        seen = model.encode({"pixels": pixels[:, None], "proprio": proprio[:, None]}, emb_keys=["proprio"])
        near(seen["pixels_emb"][:, 0], data["tokens"])
        near(seen["emb"][:, 0], data["embeddings"])
        info = {"pixels": many(pixels[:1]), "goal": many(pixels[1:]), "proprio": many(proprio[:1]), "goal_proprio": many(proprio[1:])}
        cost = model.get_cost(info, data["candidates"][None])
    near(cost[0], data["cost"])
    assert cost[0].argmin() == data["cost"].argmin()
    near(info["predicted_embedding"][0, :, 1:], data["rollout"])


@pytest.mark.parametrize(("name", "dim", "heads"), [("dinov2_small", 384, 6), ("facebook/dino-vits8", 384, 6), ("vit_base_patch16", 768, 12), (None, 192, 3)])
def test_encoders_of_published_widths_need_no_heads(tmp_path: Path, name: str | None, dim: int, heads: int) -> None:
    from stable_worldmodel_rs.wm._shapes import encoder_of
    from stable_worldmodel_rs.wm._vit import Vit, VitSizes

    # Names as the reference's training scripts write them into configs; policies of a whole training have none.
    sizes = VitSizes(dim=dim, depth=1, heads=heads, hidden=dim, patch=4, positions_for=8, dinov2=name == "dinov2_small")
    assert encoder_of(Vit(sizes).state_dict(), name, tmp_path, None, "encoder").sizes == sizes
    assert encoder_of(Vit(sizes).state_dict(), name, tmp_path, 2, "encoder").sizes.heads == 2


def policy_agrees(model: Any, data: dict[str, Any]) -> None:
    info = {key: data[key] for key in ("pixels", "goal", "proprio", "goal_proprio") if key in data}
    with torch.no_grad():
        near(model.get_action(info), data["action"])
        near(info["pixels_embed"], data["tokens"])
        if "values" in data:
            near(model.predict_values(info["embed"], info["goal_embed"]), data["values"])


def test_gcbc_equals_the_reference() -> None:
    policy_agrees(wm.load_pretrained(GOLDEN / "gcbc"), expected("gcbc"))


@pytest.mark.parametrize("folder", ["gcivl_policy", "hilp_policy"])
def test_policies_with_values_equal_the_reference(folder: str) -> None:
    path = GOLDEN / folder
    with pytest.raises(ValueError, match=f"training config .* give kind='{folder.split('_')[0]}'$"):
        wm.load_pretrained(path)
    with pytest.raises(ValueError, match="how many heads .*encoder.heads"):
        wm.load_pretrained(path, kind=folder.split("_")[0])
    policy_agrees(wm.load_pretrained(path, kind=folder.split("_")[0], extra_args=HEADS), expected(folder))


@pytest.mark.parametrize("folder", ["lewm_transformers4", "prejepa"])
def test_blocks_of_another_width_are_refused(folder: str) -> None:
    model, data = wm.load_pretrained(GOLDEN / folder), expected(folder)
    info = {"pixels": many(data["pixels"][:1]), "goal": many(data["pixels"][1:])}
    info |= {key: many(data["proprio"][:1]) for key in ("proprio", "goal_proprio") if "proprio" in data}
    with pytest.raises(ValueError, match=f"rows of 7 values were given, and the model takes {data['candidates'].shape[-1]}: .*action_block"):
        model.get_cost(info, torch.zeros(1, 4, 3, 7))


def test_num_pred_takes_no_part_in_plans() -> None:
    model = wm.load_pretrained(GOLDEN / "prejepa", extra_args={"num_pred": 2})
    assert model.num_pred == 2


# ---- files: out, in, and bad ones


def config_of(folder: str) -> dict[str, Any]:
    return json.loads((GOLDEN / folder / "config.json").read_text())


def small_lewm(tmp_path: Path) -> tuple[Path, dict[str, Any], dict[str, Any]]:
    """A folder with a good checkpoint that tests spoil; its config and tensors."""
    folder = tmp_path / "model"
    shutil.copytree(GOLDEN / "lewm_transformers4", folder)
    return folder, config_of("lewm_transformers4"), read_weights(folder / "weights.pt")


@pytest.mark.parametrize(
    ("prefix", "beside"),
    [
        ("model.", ["callbacks_modules.probe.weight", "callbacks_metrics.probe.total", "sigreg.t"]),
        ("model.", ["ema_model.encoder.layernorm.weight", "n_averaged"]),
        ("module.", ["n_averaged"]),
    ],
)
def test_what_training_keeps_beside_a_model_is_left_out(tmp_path: Path, caplog: Any, prefix: str, beside: list[str]) -> None:
    folder, _, tensors = small_lewm(tmp_path)
    wrapped = {f"{prefix}{name}": value for name, value in tensors.items()} | {name: torch.ones(3) for name in beside}
    torch.save({"state_dict": wrapped, "epoch": 1}, folder / "weights.pt")
    found = wm.load_pretrained(folder).state_dict()
    assert all(torch.equal(found[name], value) for name, value in tensors.items() if name in found) and len(found) == len(tensors)
    assert ("averaged copy" in caplog.text) == ("ema_model" in str(beside))


def test_weights_in_parts_and_a_kind_of_another_model_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="kind='gcbc': .*config.json is of another model, a LeWM; leave kind out"):
        wm.load_pretrained(GOLDEN / "lewm_transformers4", kind="gcbc")
    for name in ("model-00001-of-00002.safetensors", "model-00002-of-00002.safetensors", "model.safetensors.index.json"):
        (tmp_path / name).write_text("{}")
    with pytest.raises(ValueError, match=r"in 2 parts \(model.safetensors.index.json\), .* save_file"):
        wm.load_pretrained(tmp_path)


def test_the_config_of_lewms_own_training_script_is_read(tmp_path: Path) -> None:
    folder, config, _ = small_lewm(tmp_path)
    names = {"Predictor": "ARPredictor", "Embedder": "Embedder", "MLP": "MLP"}
    text = json.dumps({**config, "_target_": "jepa.JEPA", "embed_dim": 24, "history_size": 3})
    for ours, theirs in names.items():
        text = text.replace(f"stable_worldmodel.wm.lewm.module.{ours}\"", f'module.{theirs}"')
    (folder / "config.json").write_text(text)
    assert "module.ARPredictor" in text
    joint_agrees(wm.load_pretrained(folder), expected("lewm_transformers4"))
    # A part that no model has is no setting of a script.
    (folder / "config.json").write_text(json.dumps({**config, "decoder": {"depth": 1}}))
    with pytest.raises(ValueError, match="decoder is no setting that is known here"):
        wm.load_pretrained(folder)


def test_a_prejepa_of_the_config_of_its_training_is_read(tmp_path: Path) -> None:
    source, data = GOLDEN / "prejepa", expected("prejepa")
    model = config_of("prejepa")
    tensors = read_weights(next(source.glob("*.pt")))
    frozen = {name.replace("backbone.", "backbone.backbone.", 1) if name.startswith("backbone.") else name: value for name, value in tensors.items()}
    config = {
        "output_model_name": "dinowm",
        "wm": {"history_size": 3, "num_preds": 1, "encoding": dict.fromkeys(model["extra_encoders"]["modules"], 1)},
        "predictor": {"heads": 2, "dim_head": 6},
        "backbone": {"name": "backbone"},
    }
    shutil.copytree(source / "backbone", tmp_path / "backbone")
    pixels = data["pixels"]
    info = {"pixels": many(pixels[:1]), "goal": many(pixels[1:]), "proprio": many(data["proprio"][:1]), "goal_proprio": many(data["proprio"][1:])}
    for settings, kind in ((config, "dino-wm"), (model, None)):
        (tmp_path / "config.json").write_text(json.dumps(settings))
        torch.save(dict(sorted(frozen.items())), tmp_path / "weights.pt")
        loaded = wm.load_pretrained(tmp_path, kind=kind)
        assert loaded.image_size == 16
        with torch.no_grad():
            near(loaded.get_cost(dict(info), data["candidates"][None])[0], data["cost"])
    (tmp_path / "config.json").write_text(json.dumps({**config, "wm": {"history_size": 2}}))
    with pytest.raises(ValueError, match="config.json has wm.history_size 2, and its 48 positions are not those"):
        wm.load_pretrained(tmp_path, kind="dino-wm")
    with pytest.raises(ValueError, match=r"training config \(dinowm\), .* give kind='dino-wm'$"):
        wm.load_pretrained(tmp_path)
    (tmp_path / "config.json").write_text(json.dumps({**config, "output_model_name": "mine"}))
    with pytest.raises(ValueError, match="training config .* give kind='lewm' or .* or 'dino-wm' or 'tdmpc2'"):
        wm.load_pretrained(tmp_path)
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(ValueError, match="config.json is empty"):
        wm.load_pretrained(tmp_path)


@pytest.mark.parametrize("file", ["lewm_trainer/last.ckpt", "pldm/weights_epoch_1.pt"])
def test_joint_models_need_no_config_of_their_own(file: str, tmp_path: Path) -> None:
    case, name = file.split("/")
    kind, known = case.split("_")[0], config_of(case)
    shutil.copy(GOLDEN / file, tmp_path)
    sizes = {name: known["predictor"][name] for name in ("heads", "dim_head")}
    heads = {"encoder.heads": known["encoder"]["num_attention_heads"]}
    with pytest.raises(ValueError, match=f"{tmp_path} has no config.json, .*, or give kind='lewm' or 'pldm' or "):
        wm.load_pretrained(tmp_path)
    with pytest.raises(ValueError, match=f"{kind}: encoder: no file says how many heads .*'encoder.heads': N"):
        wm.load_pretrained(tmp_path, kind=kind)
    with pytest.raises(ValueError, match=f"{kind}: the heads of its predictor, .* are in no file; .*'predictor.heads': N"):
        wm.load_pretrained(tmp_path, kind=kind, extra_args=heads)
    with pytest.raises(ValueError, match="has 6 heads of 1 values, and the weights have 12 in all"):
        wm.load_pretrained(tmp_path, kind=kind, extra_args={**heads, "predictor.heads": 6, "predictor.dim_head": 1})
    models = [wm.load_pretrained(tmp_path, kind=kind, extra_args={**heads, "predictor.heads": sizes["heads"]})]
    # Of a whole training, without the class of its model.
    training = {"output_model_name": f"my_{kind}", "wm": {"history_size": 3}, "predictor": {**sizes, "dropout": 0.2}}
    (tmp_path / "config.json").write_text(json.dumps(training))
    with pytest.raises(ValueError, match=rf"training config \(my_{kind}\), .* give kind='{kind}'$"):
        wm.load_pretrained(tmp_path)
    models.append(wm.load_pretrained(tmp_path, kind=kind, extra_args=heads))
    assert models[1].predictor.transformer.layers[0].mlp.net[3].p == 0.2
    for at, model in enumerate(models):
        assert type(model) is (wm.LeWM if kind == "lewm" else wm.PLDM)
        joint_agrees(model, expected(case))
        folder = wm.save_pretrained(model, tmp_path / f"saved{at}")
        again = wm.load_pretrained(folder, kind=kind)
        joint_agrees(again, expected(case))
        mine, state = again.state_dict(), model.state_dict()
        assert mine.keys() == state.keys() and all(torch.equal(mine[name], state[name]) for name in state)
    (tmp_path / "config.json").unlink()
    *most, last = read_weights(GOLDEN / file).items()
    torch.save(dict(most), tmp_path / name)
    heads |= {"predictor.heads": 2}
    for wrong, match in (
        (kind, rf"90 of 91 tensors fit; missing: {last[0]}. Is it of another model than {kind}\?"),
        ("gcbc", "gcbc: action_predictor: the file lacks 'pos_embedding_goal'; it is of another model"),
        ("other", "kind 'other' is not known; give one of lewm, pldm, gcbc"),
    ):
        with pytest.raises(ValueError, match=match):
            wm.load_pretrained(tmp_path, kind=wrong, extra_args=heads)


def test_agents_need_their_config(tmp_path: Path) -> None:
    shutil.copy(GOLDEN / "tdmpc2_state" / "weights_epoch_1.pt", tmp_path)
    with pytest.raises(ValueError, match="has no config.json, and no other file has the range of rewards of a TD-MPC2"):
        wm.load_pretrained(tmp_path, kind="tdmpc2")


def test_policies_need_no_config(tmp_path: Path) -> None:
    shutil.copy(GOLDEN / "gcbc" / "weights_epoch_3.pt", tmp_path)
    policy_agrees(wm.load_pretrained(tmp_path, kind="gcbc", extra_args={**HEADS, "predictor.heads": 2}), expected("gcbc"))


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("level1.backbone.layer1.0.weight", r"a model of vladisai/PLDM \(MeNet\)"),
        ("level1._orig_mod.backbone.layer1.0.weight", r"a model of vladisai/PLDM \(MeNet\)"),
        ("predictor.rnn.weight_ih_l0", r"a model of vladisai/PLDM \(RNN\)"),
        ("predictor.action_proj.weight", "the GCBC of stable-worldmodel 0.0.3"),
        ("predictor.module.predictor_blocks.0.norm1.weight", "a predictor of facebookresearch/jepa-wms"),
    ],
)
@pytest.mark.parametrize("beside", [True, False], ids=["config", "no config"])
def test_models_of_others_are_refused_by_name(name: str, what: str, beside: bool, tmp_path: Path) -> None:
    part, rest = name.split(".", 1)
    torch.save({"model_state_dict": {name: torch.ones(2, 2)}, "epoch": 3, "step": 7}, tmp_path / "epoch=3_sample_step=7.ckpt")
    torch.save({part: {rest: torch.ones(2, 2)}, "epoch": 3}, tmp_path / "archive.pth.tar")
    if beside:
        (tmp_path / "config.json").write_text(json.dumps(config_of("lewm_transformers4")))
    for file in (tmp_path, tmp_path / "archive.pth.tar"):
        with pytest.raises(ValueError, match=rf"(ckpt|tar) is {what}.*, which this package does not have; load it by"):
            wm.load_pretrained(file)


@pytest.mark.parametrize("inside", [{"model_config": {"baseline": "lewm"}}, {"agent": {"agent": "tdmpc2"}}], ids=["model", "agent"])
def test_runs_are_refused_with_what_makes_a_checkpoint_of_them(inside: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tmp_path / "runs" / "x"
    (run / "checkpoints").mkdir(parents=True)
    (run / "config.json").write_text(json.dumps({"version": 1, **inside}))
    weights = run / "checkpoints" / "step-100.safetensors"
    weights.write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    for name in ("runs/x", "runs/x/checkpoints/step-100.safetensors"):
        with pytest.raises(ValueError, match="^runs/x is a run of this program, not a published checkpoint: `swm export runs/x --out FOLDER` makes"):
            wm.load_pretrained(name)
    # A checkpoint within a run's folder is none.
    shutil.copytree(GOLDEN / "lewm_transformers4", run / "export")
    for name in ("runs/x/export", "runs/x/export/weights.pt"):
        assert isinstance(wm.load_pretrained(name), wm.LeWM)
    (run / "config.json").write_text(json.dumps({"version": 1, "model_config": {"baseline": "canonical"}}))
    with pytest.raises(ValueError, match="is a run of canonical, .*; load_canonical reads it"):
        wm.load_pretrained(run)


def test_bytes_are_resized_to_what_the_predictor_takes() -> None:
    model, data = wm.load_pretrained(GOLDEN / "prejepa"), expected("prejepa")
    large = data["pixels"].repeat_interleave(2, 1).repeat_interleave(2, 2)
    assert model.image_size == data["pixels"].shape[1]
    with torch.no_grad():
        tokens = model.encode({"pixels": large[:, None]}, emb_keys=[])["pixels_emb"]
        small = torch.nn.functional.interpolate(normalized(large), size=(16, 16), mode="bilinear", antialias=True)
        assert torch.allclose(tokens, model.encode({"pixels": small[:, None]}, emb_keys=[])["pixels_emb"], atol=1e-5)
    with pytest.raises(ValueError, match="images of 32x32 have 64 patches, and this model is of 16; give images of 16x16"):
        model.encode({"pixels": torch.zeros(1, 1, 3, 32, 32)}, emb_keys=[])


def test_an_export_has_the_normalization_of_its_model(tmp_path: Path) -> None:
    shutil.copytree(GOLDEN / "prejepa", tmp_path / "own")
    (tmp_path / "own" / "swm.json").write_text(json.dumps({"set": {"normalization": "half"}}))
    pixels = expected("prejepa")["pixels"]
    own, other = wm.load_pretrained(tmp_path / "own"), wm.load_pretrained(GOLDEN / "prejepa")
    with torch.no_grad():
        seen = own.encode({"pixels": pixels[:, None]}, emb_keys=[])["pixels_emb"]
        given = (pixels.float() / 127.5 - 1).movedim(-1, -3)[:, None]
        assert torch.allclose(seen, other.encode({"pixels": given}, emb_keys=[])["pixels_emb"], atol=1e-5)
    (tmp_path / "own" / "swm.json").write_text("[]")
    with pytest.raises(ValueError, match="swm.json is damaged: .*; export the run again"):
        wm.load_pretrained(tmp_path / "own")


def test_a_model_is_saved_by_the_references_arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STABLEWM_HOME", str(tmp_path))
    model, config = wm.load_pretrained(GOLDEN / "lewm_transformers4"), config_of("lewm_transformers4")
    assert wm.save_pretrained(model, run_name="mine", config={"model": config, "seed": 1}, config_key="model") == tmp_path / "checkpoints" / "mine"
    joint_agrees(wm.load_pretrained("mine"), expected("lewm_transformers4"))
    assert wm.save_pretrained(model, run_name="b", cache_dir=tmp_path / "other") == tmp_path / "other" / "checkpoints" / "b"
    for wrong in ({}, {"folder": tmp_path, "run_name": "a"}, {"folder": tmp_path, "cache_dir": tmp_path}):
        with pytest.raises(TypeError, match="give"):
            wm.save_pretrained(model, **wrong)


def test_what_is_saved_is_loaded_again(tmp_path: Path) -> None:
    model, config = wm.load_pretrained(GOLDEN / "lewm_transformers4"), config_of("lewm_transformers4")
    folder = wm.save_pretrained(model, tmp_path / "four", config)
    assert sorted(path.name for path in folder.iterdir()) == ["config.json", "weights.pt"]
    stored = torch.load(folder / "weights.pt", weights_only=True)
    golden = torch.load(GOLDEN / "lewm_transformers4" / "weights.pt", weights_only=True)
    assert set(stored) == set(golden) and all(torch.equal(stored[name], golden[name]) for name in golden)
    # In the names of the other version, and from a compiled module.
    folder = wm.save_pretrained(torch.compile(model), tmp_path / "five", config, transformers=5)
    stored = torch.load(folder / "weights.pt", weights_only=True)
    assert "encoder.layers.0.attention.q_proj.weight" in stored and not any("_orig_mod" in name for name in stored)
    joint_agrees(wm.load_pretrained(folder), expected("lewm_transformers4"))
    # Replaced as a whole; a config of another model is refused, and nothing is replaced.
    other = copy.deepcopy(config)
    other["predictor"]["depth"] = 1
    with pytest.raises(ValueError, match="config is of a model with other tensors than this one: predictor.transformer.layers.1"):
        wm.save_pretrained(model, folder, other)
    assert json.loads((folder / "config.json").read_text()) == config
    with pytest.raises(NotADirectoryError, match="is a file; name a folder"):
        wm.save_pretrained(model, folder / "weights.pt", config)


def test_a_loaded_model_is_saved_with_its_own_config(tmp_path: Path) -> None:
    for name in ("lewm_transformers4", "prejepa", "gcbc"):
        model = wm.load_pretrained(GOLDEN / name)
        folder = wm.save_pretrained(copy.deepcopy(model), tmp_path / name)
        assert json.loads((folder / "config.json").read_text()) == config_of(name)
        again, state = wm.load_pretrained(folder).state_dict(), model.state_dict()
        assert again.keys() == state.keys() and all(torch.equal(again[key], state[key]) for key in state)
    built = wm.from_config(config_of("lewm_transformers4"), transformers=4)
    assert wm.load_pretrained(wm.save_pretrained(built, tmp_path / "built")) is not None
    with pytest.raises(ValueError, match="config: this model holds none"):
        wm.save_pretrained(torch.nn.Linear(1, 1), tmp_path / "other")
    assert not (tmp_path / "other").exists()


def of_a_training(case: str, tmp_path: Path) -> Any:
    """A model whose config is that of a whole training, or of none; its golden outputs hold for it."""
    if case == "archive":
        return wm.load_pretrained(GOLDEN / "dino_wm", encoder=GOLDEN / "dino_wm" / "backbone.pth", extra_args={**HEADS, "predictor.heads": 2})
    if case.endswith("_policy"):
        return wm.load_pretrained(GOLDEN / case, kind=case.split("_")[0], extra_args=HEADS)
    source = tmp_path / "source"
    source.mkdir()
    if case == "gcivl_value":
        # As the first phase leaves it: what is frozen later is a student here, and has a teacher.
        held = {"value_predictor.backbone.": ("value_predictor.student.", "value_predictor.teacher.")}
        tensors = read_weights(GOLDEN / "gcivl_policy" / "weights_epoch_3.pt")
        for inner, names in held.items():
            for name in [name for name in tensors if name.startswith(inner)]:
                tensors |= {new + name[len(inner) :]: tensors[name].clone() for new in names}
                del tensors[name]
        tensors |= {f"value_predictor.{name}_coefficient": torch.tensor(0.995) for name in ("base_ema", "final_ema", "ema")}
        torch.save(tensors, source / "weights.pt")
        shutil.copy(GOLDEN / "gcivl_policy" / "config.json", source)
        return wm.load_pretrained(source, kind="gcivl", extra_args=HEADS)
    assert case == "tdmpc2_state"
    shutil.copy(GOLDEN / case / "weights_epoch_1.pt", source)
    (source / "config.json").write_text(json.dumps({**config_of(case)["cfg"], "output_model_name": "tdmpc2", "subdir": "${hydra:job.id}"}))
    return wm.load_pretrained(source, kind="tdmpc2")


@pytest.mark.parametrize("case", ["gcivl_policy", "hilp_policy", "gcivl_value", "archive", "tdmpc2_state"])
def test_a_model_of_a_whole_training_is_saved_with_a_config_of_its_own(case: str, tmp_path: Path) -> None:
    model = of_a_training(case, tmp_path)
    folder = wm.save_pretrained(model, tmp_path / "saved")
    assert json.loads((folder / "config.json").read_text())["_target_"].startswith("stable_worldmodel.wm.")
    again = wm.load_pretrained(folder)
    mine, state = again.state_dict(), model.state_dict()
    assert mine.keys() == state.keys() and all(torch.equal(mine[name], state[name]) for name in state)
    if case == "tdmpc2_state":
        data = expected(case)
        with torch.no_grad():
            assert torch.equal(*(one.encode({"state": data["state"]}) for one in (model, again)))
        return
    if case == "archive":
        # The reference normalizes as ImageNet's, and the authors do not.
        assert json.loads((folder / "swm.json").read_text()) == {"version": 1, "set": {"normalization": "half"}}
        data = expected("dino_wm")
        with torch.no_grad():
            seen = [one.encode({"pixels": data["pixels"][:, None]}, emb_keys=[])["emb"] for one in (model, again)]
        assert torch.equal(*seen)
        near(seen[0][:, 0], data["tokens"])
    else:
        policy_agrees(again, expected(case.replace("value", "policy")))
    # All that the reference's `create_backbone` reads in the place of a repository.
    stored = read_weights(folder / "backbone" / "model.safetensors")
    known = json.loads((folder / "backbone" / "config.json").read_text())
    place = "backbone." if case == "archive" else "encoder.backbone."
    own = {name for name in state if name.startswith(place)}
    assert known["model_type"] == "dinov2" and known["num_attention_heads"] == HEADS["encoder.heads"] and len(stored) == len(own)
    assert torch.equal(stored["encoder.layer.0.attention.attention.key.weight"], state[f"{place}encoder.layer.0.attention.k_proj.weight"])


def test_normalization_is_saved_in_the_notes_of_an_export(tmp_path: Path) -> None:
    model = of_a_training("archive", tmp_path)
    notes = {"version": 1, "env": "swm/PushT-v1", "set": {"image": 16}}
    (tmp_path / "swm.json").write_text(json.dumps(notes))
    wm.save_pretrained(model, tmp_path)
    assert json.loads((tmp_path / "swm.json").read_text()) == {**notes, "set": {"image": 16, "normalization": "half"}}
    wm.save_pretrained(wm.load_pretrained(GOLDEN / "prejepa"), tmp_path)
    assert json.loads((tmp_path / "swm.json").read_text())["set"]["normalization"] == "imagenet"
    # Of another encoder than the one that was there.
    assert wm.load_pretrained(tmp_path).backbone.sizes.dim == 18
    wm.save_pretrained(wm.load_pretrained(GOLDEN / "gcbc"), tmp_path / "other")
    assert not (tmp_path / "other" / "swm.json").exists()


def test_an_encoder_by_name_is_saved_with_the_model(tmp_path: Path) -> None:
    model, config = wm.load_pretrained(GOLDEN / "prejepa"), config_of("prejepa")
    wm.save_pretrained(model, tmp_path, config, transformers=4)
    stored = torch.load(tmp_path / "weights.pt", weights_only=True)
    assert "backbone.encoder.layer.0.attention.attention.query.weight" in stored
    heads = tmp_path / "backbone" / "config.json"
    assert config["encoder"]["name"] == "backbone" and json.loads(heads.read_text())["num_attention_heads"] == HEADS["encoder.heads"]
    shutil.rmtree(heads.parent)
    with pytest.raises(ValueError, match="how many heads"):
        wm.load_pretrained(tmp_path)
    again, given = wm.load_pretrained(tmp_path, extra_args=HEADS).state_dict(), model.state_dict()
    assert len(again) == len(given)
    shutil.copytree(GOLDEN / "prejepa" / "backbone", tmp_path / "backbone")
    loaded = wm.load_pretrained(tmp_path)
    pixels = expected("prejepa")["pixels"][:, None]
    with torch.no_grad():
        assert torch.equal(*(one.encode({"pixels": pixels}, emb_keys=[])["emb"] for one in (model, loaded)))


PAPER = {"pusht": 10, "cube": 25}


@pytest.mark.parametrize("values", PAPER.values(), ids=PAPER)
def test_the_papers_model_has_its_tensors(values: int) -> None:
    root = "stable_worldmodel.wm.lewm.module"
    norm = {"_target_": "torch.nn.BatchNorm1d", "_partial_": True}
    mlp = {"_target_": f"{root}.MLP", "input_dim": 192, "output_dim": 192, "hidden_dim": 2048, "norm_fn": norm}
    config = {
        "_target_": "stable_worldmodel.wm.lewm.LeWM",
        "encoder": {
            **{"_target_": "stable_pretraining.backbone.utils.vit_hf", "size": "tiny", "patch_size": 14, "image_size": 224},
            **{"pretrained": False, "use_mask_token": False},
        },
        "predictor": {
            **{"_target_": f"{root}.Predictor", "num_frames": 3, "input_dim": 192, "hidden_dim": 192, "output_dim": 192, "depth": 6},
            **{"heads": 16, "mlp_dim": 2048, "dim_head": 64, "dropout": 0.1, "emb_dropout": 0.0},
        },
        "action_encoder": {"_target_": f"{root}.Embedder", "input_dim": values, "emb_dim": 192},
        "projector": mlp,
        "pred_proj": mlp,
    }
    with torch.device("meta"):
        state = wm.from_config(config, transformers=4).state_dict()
    assert len(state) == 303
    assert state["action_encoder.patch_embed.weight"].shape == (10, values, 1)
    assert state["encoder.encoder.layer.11.attention.attention.query.weight"].shape == (192, 192)
    if values == 25:
        assert sum(value.numel() for value in state.values()) == 18_042_822


def test_names_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home, hub = tmp_path / "home", tmp_path / "hub"
    monkeypatch.setenv("STABLEWM_HOME", str(home))
    monkeypatch.setenv("HF_HUB_CACHE", str(hub))
    source = GOLDEN / "lewm_transformers4"
    with pytest.raises(FileNotFoundError, match=r"me/lewm is neither .*download_model\('me/lewm'\), or `hf download me/lewm`"):
        wm.load_pretrained("me/lewm")
    snapshot = hub / "models--me--lewm" / "snapshots" / "abc"
    shutil.copytree(source, snapshot)
    assert isinstance(wm.load_pretrained("hf:me/lewm"), wm.LeWM)
    shutil.copytree(source, hub / "models--me--lewm" / "snapshots" / "def")
    with pytest.raises(ValueError, match="several revisions: abc, def"):
        wm.load_pretrained("me/lewm")
    (hub / "models--me--lewm" / "refs").mkdir()
    (hub / "models--me--lewm" / "refs" / "main").write_text("def")
    assert isinstance(wm.load_pretrained("me/lewm"), wm.LeWM)
    shutil.copytree(source, home / "checkpoints" / "mine")
    assert isinstance(wm.load_pretrained("mine"), wm.LeWM)
    assert isinstance(wm.load_pretrained("mine/weights"), wm.LeWM)
    with pytest.raises(FileNotFoundError, match="nothing is neither a file nor a folder here"):
        wm.load_pretrained("nothing")
    shutil.copy(source / "weights.pt", home / "checkpoints" / "mine" / "weights_epoch_2.pt")
    with pytest.raises(ValueError, match="holds 2 files of weights: weights.pt, weights_epoch_2.pt; give one"):
        wm.load_pretrained("mine")


BAD_FILES = {
    "complex.pt": "encoder.embeddings.cls_token is complex",
    "sparse.pt": "a.weight is sparse",
    "empty.pt": "holds no tensors",
    "page.pt": "is a web page in the place of the file",
    "pointer.pt": r"is a pointer of Git LFS, not the weights \(72,000,000 bytes\)",
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_bad_files_are_refused(name: str, tmp_path: Path) -> None:
    folder, _, _ = small_lewm(tmp_path)
    (folder / "weights.pt").unlink()
    shutil.copy(GOLDEN / "bad" / name, folder)
    with pytest.raises(ValueError, match=f"{name}.*{BAD_FILES[name]}"):
        wm.load_pretrained(folder)


class Calls:
    def __reduce__(self) -> Any:
        return Path.touch, (Path("called"),)


def test_spoiled_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.chdir(tmp_path)
    folder, _, state = small_lewm(tmp_path)
    file, whole = folder / "weights.pt", (folder / "weights.pt").read_bytes()
    first, *_, last = state

    def refused(spoiled: Any, match: str) -> None:
        if isinstance(spoiled, bytes):
            file.write_bytes(spoiled)
        else:
            torch.save(spoiled, file)
        with pytest.raises(ValueError, match=match):
            wm.load_pretrained(folder)

    refused(b"", "is empty: the download failed")
    refused(whole[: len(whole) // 2], r"is cut off \([\d,]+ bytes")
    at = whole.index(state[last].numpy().tobytes()) if state[last].numel() > 16 else len(whole) // 2
    refused(whole[:at] + bytes(8) + whole[at + 8 :], "the checksum of its record .* differs. Fetch it again")
    wide = next(name for name in state if state[name].ndim == 2)
    refused({**state, wide: state[wide].to(torch.int8)}, rf"{wide} hold whole numbers \(torch.int8\), and models take floats")
    refused(whole[: len(whole) // 2] + whole[-64:], "no file of torch.save, or a damaged one")
    refused({name: state[name] for name in list(state)[:-1]}, f"90 of 91 tensors fit; missing: {last}")
    refused({**state, "extra.weight": torch.zeros(2)}, "91 of 91 tensors fit; not used: extra.weight")
    refused({**state, first: state[first][..., :-1].clone()}, rf"shapes: {first}: \(1, 1, 23\) in the file, \(1, 1, 24\) by config")
    refused({**state, first: state[first] * float("nan")}, f"{first} holds values that are not finite")
    variance = next(name for name in state if name.endswith("running_var"))
    refused({**state, variance: -state[variance]}, f"{variance} holds negative variances")
    refused({first: torch.zeros(1).expand(1 << 40)}, "is a view of 1,099,511,627,776 values over fewer")
    torch.save({"state_dict": state, "x": Calls()}, file)
    joint_agrees(wm.load_pretrained(folder), expected("lewm_transformers4"))
    assert "would call builtins.getattr if Python loaded it; ignored here. Do not load it with torch.load" in caplog.text
    assert not (tmp_path / "called").exists()
    refused(b"\xff" * 7 + b"\x00" + b"{" + b"x" * 64, "no valid file of safetensors: its header has")


def without_classes(file: Path) -> None:
    """Gives the classes of this package in a file the names of one that nobody has."""

    def renamed(stored: bytes) -> bytes:
        changed = stored.replace(b"stable_worldmodel_rs", b"stable_worldmodel_xx")
        assert changed != stored
        return changed

    if not zipfile.is_zipfile(file):
        file.write_bytes(renamed(file.read_bytes()))
        return
    with zipfile.ZipFile(file) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(file, "w") as archive:
        for name, stored in entries.items():
            archive.writestr(name, renamed(stored) if name.endswith("data.pkl") else stored)


@pytest.mark.parametrize("options", [{}, {"pickle_protocol": 4}, {"_use_new_zipfile_serialization": False}], ids=["zip", "protocol 4", "legacy"])
def test_whole_modules_are_read_without_their_classes(options: dict[str, Any], tmp_path: Path) -> None:
    folder, _, state = small_lewm(tmp_path)
    model = wm.load_pretrained(folder)
    model.projector.register_buffer("idle", torch.zeros(2), persistent=False)
    for whole in (model, {"model": model, "epoch": 3, "optimizer": torch.optim.AdamW(model.parameters())}):
        torch.save(whole, folder / "weights.pt", **options)
        without_classes(folder / "weights.pt")
        again = read_weights(folder / "weights.pt")
        assert again.keys() == state.keys() and all(torch.equal(again[name], state[name]) for name in state)
        joint_agrees(wm.load_pretrained(folder), expected("lewm_transformers4"))


def archive(file: Path, pickled: bytes) -> Path:
    """A file of `torch.save` with another pickle."""
    with zipfile.ZipFile(file, "w") as out:
        out.writestr("archive/data.pkl", pickled)
        out.writestr("archive/version", "3")
    return file


def test_pickles_that_would_harm_do_not(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "weights.pt"
    # An object that is numbered four billion, for which an unpickler would make room.
    for pickled, part in [
        (b"\x80\x02cos\nsystem\n)r\xff\xff\xff\xffR.", "calls an object by number 4,294,967,295"),
        (b"\x80\x02cos\nsystem\n\x82\x01R.", "has the opcode EXT1"),
        (b"\x80\x02cos\nsystem\n)RQ.", "damaged one"),
        (b"\x80\x02X\x01\x00\x00\x00a)R.", "damaged one"),
        (b"\x80\x02cos\nsystem\n)R}b", "damaged one"),
        # A dict that contains itself twice.
        (b"\x80\x02cx\ny\n0}q\x00(X\x01\x00\x00\x00ah\x00X\x01\x00\x00\x00bh\x00u.", "nested more than 64 deep"),
    ]:
        with pytest.raises(ValueError, match=part):
            read_weights(archive(file, pickled))
    # A class gets no attributes, and what a function would make has none.
    for pickled in (b"\x80\x02cbuiltins\nset\n}X\x03\x00\x00\x00popK\x01sb.", b"\x80\x02cbuiltins\neval\nX\x04\x00\x00\x00quit\x85R]a."):
        caplog.clear()
        with pytest.raises(ValueError, match="weights.pt"):
            read_weights(archive(file, pickled))
        assert ("would call" in caplog.text) == (b"eval" in pickled)


def test_the_archive_of_dino_wm_is_a_prejepa(tmp_path: Path) -> None:
    source, data = GOLDEN / "dino_wm", expected("dino_wm")
    heads, encoder = {"encoder.heads": 3, "predictor.heads": 2}, source / "backbone.pth"
    with pytest.raises(ValueError, match="the encoder, a frozen DINOv2, are not in the file; give encoder='dinov2_vits14_pretrain.pth'"):
        wm.load_pretrained(source)
    for lacking in heads:
        given = {name: value for name, value in heads.items() if name != lacking}
        with pytest.raises(ValueError, match=f"model_latest.pth: .*{lacking}"):
            wm.load_pretrained(source, encoder=encoder, extra_args=given)
    model = wm.load_pretrained(source, encoder=encoder, extra_args=heads)
    assert isinstance(model, wm.PreJEPA) and model.image_size == 16
    pixels, proprio = data["pixels"], data["proprio"]
    with torch.no_grad():
        near(model.encode({"pixels": pixels[:, None]}, emb_keys=[])["pixels_emb"][:, 0], data["tokens"])
        info = {"pixels": many(pixels[:1]), "goal": many(pixels[1:]), "proprio": many(proprio[:1]), "goal_proprio": many(proprio[1:])}
        cost = model.get_cost(info, data["candidates"][None])
    near(cost[0], data["cost"])
    assert cost[0].argmin() == data["cost"].argmin()
    near(info["predicted_embedding"][0, :, 1:], data["rollout"])
    # The file by its own name, and an archive whose history is another one.
    folder = tmp_path / "archive"
    shutil.copytree(source, folder)
    wm.load_pretrained(folder / "checkpoints" / "model_latest.pth", encoder=encoder, extra_args=heads)
    text = (folder / "hydra.yaml").read_text()
    (folder / "hydra.yaml").write_text(text.replace("num_hist: 3", "num_hist: 2"))
    with pytest.raises(ValueError, match="hydra.yaml has num_hist 2, and its 48 positions are not those"):
        wm.load_pretrained(folder, encoder=encoder, extra_args=heads)
    with pytest.raises(ValueError, match="encoder: .*weights.pt has an encoder of its own"):
        wm.load_pretrained(GOLDEN / "lewm_transformers4", encoder=encoder)


@pytest.mark.parametrize(("case", "weights"), [("lewm_trainer", "last.ckpt"), ("tdmpc2_state", "weights_epoch_1.pt")])
def test_the_config_of_a_training_script_has_the_model_in_it(case: str, weights: str, tmp_path: Path) -> None:
    for name in (weights, "config.yaml"):
        shutil.copy(GOLDEN / case / name, tmp_path)
    found, wanted = (wm.load_pretrained(folder / weights) for folder in (tmp_path, GOLDEN / case))
    assert type(found) is type(wanted)
    mine: dict[str, Any] = found.state_dict()
    assert all(torch.equal(mine[name], value) for name, value in wanted.state_dict().items()) and len(mine) > 10
    config = (tmp_path / "config.yaml").read_text()
    for text, match in (("model: *other\n", "config.yaml is no config of Hydra: line 1: "), ("a: 1\n  b: 2\n", "line 2: ")):
        (tmp_path / "config.yaml").write_text(text)
        with pytest.raises(ValueError, match=match):
            wm.load_pretrained(tmp_path)
    (tmp_path / "config.yaml").write_text(config.replace("embed_dim: 12", "other: 12").replace("enc_dim: 16", "enc_dim: ${other}"))
    with pytest.raises(ValueError, match=r"\$\{"):
        wm.load_pretrained(tmp_path)


def test_bad_configs_are_refused(tmp_path: Path) -> None:
    folder, config, _ = small_lewm(tmp_path)

    def refused(changes: dict[str, Any], match: str) -> None:
        (folder / "config.json").write_text(json.dumps({**config, **changes}))
        with pytest.raises(ValueError, match=match):
            wm.load_pretrained(folder)

    bad = {name: json.loads((GOLDEN / "bad" / name / "config.json").read_text()) for name in ("call", "unknown_class", "unfilled", "layernorm")}
    refused(bad["call"], "encoder: builtins.print is no module of a known model; nothing of a config is executed")
    refused(bad["unknown_class"], "my_lab.models.Dreamer is no model that this package has; known are lewm, pldm")
    refused(bad["unfilled"], r"action_encoder.input_dim is \?\?\?: an unfinished Hydra config")
    refused(bad["layernorm"], "not used: projector.net.1.running_mean")
    predictor = config["predictor"]
    refused({"predictor": {**predictor, "depths": 2}}, "predictor.depths is no setting that is known here; known are num_frames")
    refused({"predictor": {**predictor, "depth": 10**9}}, "predictor.depth is 1000000000; give 0 to 1000")
    refused({"predictor": {**predictor, "heads": True}}, "predictor.heads is True, and int is wanted")
    refused({"predictor": {**predictor, "heads": "2"}}, "predictor.heads is '2', and int is wanted")
    refused({"predictor": 3}, "predictor is no module; give its settings with a _target_")
    lacking = {key: value for key, value in predictor.items() if key != "depth"}
    refused({"predictor": lacking}, "predictor lacks depth")
    refused({"encoder": {**config["encoder"], "pretrained": True}}, "would fetch weights")
    refused({"projector": {**config["projector"], "norm_fn": {"_target_": "os.system", "_partial_": True}}}, "os.system with _partial_")
    (folder / "config.json").write_text("[1]")
    with pytest.raises(ValueError, match="holds no settings"):
        wm.load_pretrained(folder)
    (folder / "config.json").unlink()
    with pytest.raises(ValueError, match="has no config.json, which says what the weights are of"):
        wm.load_pretrained(folder)


def spoiled(config: Any, value: Any) -> list[Any]:
    """A config with each of its settings replaced in turn."""
    found: list[Any] = []
    for key, below in config.items():
        found.append({**config, key: value})
        if isinstance(below, dict):
            found += [{**config, key: one} for one in spoiled(below, value)]
    return found


@pytest.mark.parametrize("name", ["gcbc", "prejepa"])
def test_any_other_setting_is_refused_by_a_message_or_of_no_effect(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(GOLDEN / name, folder)
    loaded = refused = 0
    for value in (None, -1, {"_target_": "torch.nn.Identity"}):
        for config in spoiled(config_of(name), value):
            (folder / "config.json").write_text(json.dumps(config))
            try:
                wm.load_pretrained(folder)
                loaded += 1
            except ValueError as error:
                assert str(error)
                refused += 1
    assert refused > 4 * loaded


def test_settings_of_an_encoder_that_have_one_value_here(tmp_path: Path) -> None:
    folder, config, _ = small_lewm(tmp_path)
    usual = {"hidden_act": "gelu", "layer_norm_eps": 1e-12, "qkv_bias": True, "num_channels": 3, "hidden_dropout_prob": 0.0}
    config["encoder"] |= usual
    (folder / "config.json").write_text(json.dumps(config))
    joint_agrees(wm.load_pretrained(folder), expected("lewm_transformers4"))
    for name, value in {"hidden_act": "relu", "layer_norm_eps": 0.1, "qkv_bias": False, "attention_probs_dropout_prob": 0.1}.items():
        (folder / "config.json").write_text(json.dumps({**config, "encoder": {**config["encoder"], name: value}}))
        with pytest.raises(ValueError, match=f"config.json: encoder.{name} is {value!r}, and encoders have .* here; load such a model with"):
            wm.load_pretrained(folder)


def test_the_config_of_an_encoder_beside_the_weights_is_compared(tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(GOLDEN / "gcbc", folder)
    beside = folder / "backbone" / "config.json"
    config = json.loads(beside.read_text())
    beside.write_text(json.dumps({**config, "hidden_dropout_prob": 0.1}))  # of training alone
    policy_agrees(wm.load_pretrained(folder), expected("gcbc"))
    for name, value in {"hidden_act": "relu", "layer_norm_eps": 0.1, "use_swiglu_ffn": True}.items():
        beside.write_text(json.dumps({**config, name: value}))
        with pytest.raises(ValueError, match=f"backbone/config.json: {name} is {value!r}, and encoders have"):
            wm.load_pretrained(folder)


def test_an_encoder_with_a_pooler_is_read_and_saved(tmp_path: Path) -> None:
    tensors = read_weights(GOLDEN / "gcbc" / "weights_epoch_3.pt")
    dim = tensors["encoder.embeddings.cls_token"].shape[-1]
    more = {"encoder.pooler.dense.weight": torch.ones(dim, dim), "encoder.pooler.dense.bias": torch.ones(dim)}
    folder = tmp_path / "model"
    shutil.copytree(GOLDEN / "gcbc", folder)
    torch.save({**tensors, **more}, folder / "weights_epoch_3.pt")
    model = wm.load_pretrained(folder)
    policy_agrees(model, expected("gcbc"))
    stored = torch.load(wm.save_pretrained(model, tmp_path / "saved") / "weights.pt", weights_only=True)
    assert stored.keys() == {*tensors, *more}
    torch.save({**tensors, "encoder.embeddings.register_tokens": torch.ones(1, 4, dim)}, folder / "weights_epoch_3.pt")
    with pytest.raises(ValueError, match="it has registers, which no encoder here has"):
        wm.load_pretrained(folder)


def test_settings_can_be_given_others(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"predictor.pos_embedding: \(1, 3, 24\) in the file, \(1, 2, 24\)"):
        wm.load_pretrained(GOLDEN / "lewm_transformers4", extra_args={"predictor.num_frames": 2})
    folder, config, _ = small_lewm(tmp_path)
    config["action_encoder"]["input_dim"] = "???"
    (folder / "config.json").write_text(json.dumps(config))
    joint_agrees(wm.load_pretrained(folder, extra_args={"action_encoder.input_dim": 4}), expected("lewm_transformers4"))


def test_torch_is_imported_with_the_first_model(run_python: Any) -> None:
    done = run_python("import sys, stable_worldmodel_rs as swm\nswm.load_pretrained, swm.wm.utils\nprint('torch' in sys.modules)")
    assert done.stdout.split() == ["False"], done.stderr


def test_it_serves_under_the_references_name(run_python: Any) -> None:
    code = """from stable_worldmodel_rs import compat; compat.install()
from stable_worldmodel.wm.utils import load_pretrained
from stable_worldmodel.wm.lewm.lewm import LeWM
from stable_worldmodel.wm.loss import SIGReg
import stable_worldmodel_rs as ours
print(load_pretrained is ours.load_pretrained, LeWM is ours.wm.LeWM)"""
    assert run_python(code).stdout.split() == ["True", "True"]


def test_downloads_need_the_hub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import sys
    from types import SimpleNamespace

    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(ImportError, match="pip install huggingface_hub"):
        wm.download_model("me/lewm")
    with pytest.raises(ValueError, match="give 'user/repository'"):
        wm.download_model("lewm")
    calls: list[Any] = []

    def snapshot_download(repo: str, **options: Any) -> str:
        calls.append((repo, options["revision"], options["allow_patterns"]))
        return str(tmp_path)

    monkeypatch.setitem(sys.modules, "huggingface_hub", SimpleNamespace(snapshot_download=snapshot_download))
    assert wm.download_model("me/lewm", revision="22b3") == tmp_path
    assert calls == [("me/lewm", "22b3", ["*.json", "*.pt", "*.pth", "*.ckpt", "*.safetensors"])]

"""Torch modules of LeWM and PLDM learn as the reference does: losses, their gradients, and those of plans."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from stable_worldmodel_rs import wm  # noqa: E402
from stable_worldmodel_rs.wm import _shapes, _weights  # noqa: E402
from stable_worldmodel_rs.wm._images import normalized  # noqa: E402

from test_wm import near  # noqa: E402

PARITY = Path(__file__).resolve().parents[3] / "crates" / "swm-baselines" / "tests" / "parity"


def small(name: str, **extra: Any) -> tuple[Any, dict[str, Any]]:
    """The small model of a file of losses and gradients, and the file's tensors."""
    data = _weights._safetensors(PARITY / f"{name}.safetensors")
    norm = {"_target_": "torch.nn.BatchNorm1d", "_partial_": True}
    root = "stable_worldmodel.wm.lewm.module"
    mlp = {"_target_": f"{root}.MLP", "input_dim": 12, "hidden_dim": 18, "output_dim": 12, "norm_fn": norm}
    model: Any = wm.from_config(
        {
            "_target_": "stable_worldmodel.wm.lewm.LeWM",
            "encoder": {
                **{"_target_": "stable_pretraining.backbone.utils.vit_hf", "use_mask_token": False, "patch_size": 4, "image_size": 16},
                **{"hidden_size": 12, "num_hidden_layers": 2, "num_attention_heads": 3, "intermediate_size": 24},
            },
            "predictor": {
                **{"_target_": f"{root}.Predictor", "num_frames": 3, "depth": 2, "heads": 2, "dim_head": 5, "mlp_dim": 20},
                **{"input_dim": 12, "hidden_dim": 12},
            },
            "action_encoder": {"_target_": f"{root}.Embedder", "input_dim": 4, "smoothed_dim": 6, "emb_dim": 12},
            "projector": mlp,
            "pred_proj": mlp,
        }
    )
    for key, module in extra.items():
        model.add_module(key, module)
    weights = {key.removeprefix("weights."): value for key, value in data.items() if key.startswith("weights.")}
    lacking = model.load_state_dict(weights, strict=False)
    assert not lacking.unexpected_keys and all("num_batches_tracked" in key for key in lacking.missing_keys)
    return model, data


def trained_as(name: str, **extra: Any) -> tuple[Any, dict[str, Any], Any, Any]:
    """The same with states and predictions in training."""
    model, data = small(name, **extra)
    model.train()
    seen = model.encode({"pixels": normalized(data["inputs.pixels"].byte()), "action": data["inputs.action"]})
    states = seen["emb"]
    return model, data, states, model.predict(states[:, :-1], seen["act_emb"][:, :-1])


def gradients_agree(model: Any, data: dict[str, Any], total: Any) -> None:
    near(total.reshape(1), data["outputs.total"])
    total.backward()
    named = {f"gradients.{name}": value for name, value in model.named_parameters()}
    wanted = {name for name in data if name.startswith("gradients.")}
    assert len(wanted) > 80 and wanted <= set(named)
    for name in wanted:
        near(named[name].grad, data[name], 1e-4)


def test_lewm_learns_as_the_reference() -> None:
    model, data, states, predicted = trained_as("lewm")
    near(states, data["outputs.states"])
    near(predicted, data["outputs.predicted"])
    prediction = torch.nn.functional.mse_loss(predicted, states[:, 1:])
    normality = wm.loss.SIGReg(num_proj=32)(states.transpose(0, 1), data["inputs.directions"])
    near(normality.reshape(1), data["outputs.sigreg"])
    gradients_agree(model, data, prediction + 0.09 * normality)


def test_pldm_learns_as_the_reference() -> None:
    from stable_worldmodel_rs.wm.pldm.module import MLP

    model, data, states, predicted = trained_as("pldm", idm=MLP(24, 16, 4))
    actions = model.idm(torch.cat([states[:, 1:], states[:, :-1]], dim=-1))
    terms = wm.loss.PLDMLoss()(states, actions, data["inputs.action"][:, :-1])
    names = {"std": "std", "std_t": "std_t", "cov": "cov", "cov_t": "cov_t", "alignment": "temp_align", "inverse": "idm"}
    parts = {"prediction": torch.nn.functional.mse_loss(predicted, states[:, 1:])}
    parts |= {ours: terms[f"{theirs}_loss"] for ours, theirs in names.items()}
    parts["straightening"] = wm.loss.TemporalStraighteningLoss()(states)
    for name, part in parts.items():
        near(part.reshape(1), data[f"outputs.{name}"])
    weights = {"std": 18.0, "std_t": 0.7, "cov": 12.0, "cov_t": 0.5, "alignment": 0.2, "inverse": 1.5, "straightening": 0.3}
    gradients_agree(model, data, sum(weights.get(name, 1.0) * part for name, part in parts.items()))


@pytest.mark.parametrize("seen", [1, 3])
def test_costs_have_the_references_gradients_as_often_as_they_are_asked_for(seen: int) -> None:
    model, data = small("lewm")
    model.eval()
    pixels, action = data["inputs.pixels"].byte(), data["inputs.action"]

    def many(tensor: Any) -> Any:
        return tensor[:, None].expand(-1, 6, *tensor.shape[1:])

    info = {"pixels": many(pixels[:2, :seen]), "goal": many(pixels[2:4, :1]), "action_history": many(action[:2, : seen - 1])}
    for _ in range(2):  # Solvers give the same infos again.
        candidates = data[f"inputs.candidates{seen}"].clone().requires_grad_()
        cost = model.get_cost(info, candidates)
        near(cost, data[f"outputs.costs{seen}"])
        cost.sum().backward()
        near(candidates.grad, data[f"outputs.costs{seen}_gradient"])


@pytest.mark.parametrize("seen", [1, 3])
def test_prejepas_costs_have_the_references_gradients(seen: int) -> None:
    data = _weights._safetensors(PARITY / "dino_wm.safetensors")
    weights = {key.removeprefix("weights."): value for key, value in data.items() if key.startswith("weights.")}
    module = wm.prejepa.module
    predictor = module.CausalPredictor(num_patches=9, num_frames=3, dim=16, depth=2, heads=2, mlp_dim=20, dim_head=5)
    extra = {"proprio": module.Embedder(in_chans=3, emb_dim=2), "action": module.Embedder(in_chans=4, emb_dim=2)}
    backbone = {key.removeprefix("backbone."): value for key, value in weights.items() if key.startswith("backbone.")}
    model: Any = wm.PreJEPA(_shapes.encoder_of(backbone, None, None, 3, "backbone"), predictor, extra, history_size=3)
    lacking = model.load_state_dict(weights, strict=False)
    assert not lacking.unexpected_keys and all(name.endswith("bias") or "mask_token" in name for name in lacking.missing_keys)
    model.eval()

    def many(tensor: Any) -> Any:
        return tensor[:, None].expand(-1, 6, *tensor.shape[1:])

    pixels, proprio, action = data["inputs.pixels"].byte(), data["inputs.proprio"], data["inputs.action"]
    info = {
        **{"pixels": many(pixels[:2, :seen]), "proprio": many(proprio[:2, :seen])},
        **{"goal": many(pixels[2:4, :1]), "goal_proprio": many(proprio[2:4, :1])},
        "action_history": many(action[:2, : seen - 1]),
    }
    for _ in range(2):
        candidates = data[f"inputs.candidates{seen}"].clone().requires_grad_()
        cost = model.get_cost(info, candidates)
        near(cost, data[f"outputs.costs{seen}"])
        cost.sum().backward()
        near(candidates.grad, data[f"outputs.costs{seen}_gradient"])

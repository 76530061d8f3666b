"""Compares what `swm export` writes with the reference: its own `load_pretrained` takes the folder and computes what is expected.

    python load_exports.py SWM CHECKPOINTS WORK

SWM is the command, built with the feature baselines. CHECKPOINTS are the golden ones: each has inputs and outputs of the reference for the
checkpoint that it published (`expected.safetensors`). Each is imported, exported into WORK with the names of the installed transformers,
and loaded by the reference, whose outputs for the same inputs must be those. Needs stable-worldmodel 0.1.1.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from pathlib import Path

import torch
import transformers
from safetensors.torch import load_file
from stable_worldmodel.wm.utils import load_pretrained

Values = dict[str, torch.Tensor]

MEAN, STD = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
# As the Rust models are compared: sums in another order. Weights are the same bits.
BOUND = 1e-4

# The published file of each case, and what no file says: the model, where its config does not name it, and heads of attention.
CASES: dict[str, tuple[str, list[str]]] = {
    "lewm_transformers4": ("weights.pt", []),
    "lewm_trainer": ("last.ckpt", []),
    "pldm": ("weights_epoch_1.pt", []),
    "prejepa": ("weights.pt", []),
    "gcbc": ("weights_epoch_3.pt", []),
    "gcivl_policy": ("weights_epoch_3.pt", ["--as", "gcivl", "--set", "model.encoder.heads=3"]),
    "hilp_policy": ("weights_epoch_3.pt", ["--as", "hilp", "--set", "model.encoder.heads=3"]),
    "tdmpc2_state": ("weights_epoch_1.pt", []),
}


def frames(pixels: torch.Tensor) -> torch.Tensor:
    """Bytes ``[..., H, W, 3]`` as the reference's evaluation shows them to a model: ``[..., 3, H, W]``."""
    return ((pixels.float() / 255 - MEAN) / STD).movedim(-1, -3)


def repeated(tensor: torch.Tensor) -> torch.Tensor:
    """One problem with four candidates."""
    return tensor[None, None].expand(1, 4, *tensor.shape)


def joint(model: torch.nn.Module, given: Values) -> Values:
    """LeWM and PLDM, from one frame and from a history."""
    seen, candidates = frames(given["pixels"]), given["candidates"]
    found = {"embeddings": model.encode({"pixels": seen[:, None]})["emb"][:, 0]}
    for prefix, now, before in (
        ("", seen[:1], candidates[:, :0]),
        ("past_", frames(given["past_pixels"]), given["past_actions"].expand(4, -1, -1)),
    ):
        info = {"pixels": repeated(now), "goal": repeated(seen[1:]), "action": torch.zeros(1, 4, len(now), candidates.shape[-1])}
        found[f"{prefix}cost"] = model.get_cost(info, torch.cat([before, candidates], dim=1)[None])[0]
        found[f"{prefix}rollout"] = info["predicted_emb"][0, :, len(now) :]
    return found


def tokens(model: torch.nn.Module, given: Values) -> Values:
    """PreJEPA."""
    seen, proprio, candidates = frames(given["pixels"]), given["proprio"], given["candidates"]
    encoded = model.encode({"pixels": seen[:, None], "proprio": proprio[:, None]}, emb_keys=["proprio"])
    info = {
        "pixels": repeated(seen[:1]), "goal": repeated(seen[1:]), "proprio": repeated(proprio[:1]), "goal_proprio": repeated(proprio[1:]),
        "action": torch.zeros(1, 4, 1, candidates.shape[-1]), "id": torch.zeros(1, 4, 1), "step_idx": torch.zeros(1, 4, 1),
    }  # fmt: skip
    cost = model.get_cost(info, candidates[None])[0]
    return {"tokens": encoded["pixels_emb"][:, 0], "embeddings": encoded["emb"][:, 0], "cost": cost, "rollout": info["predicted_embedding"][0, :, 1:]}


def policy(model: torch.nn.Module, given: Values) -> Values:
    """Goal-conditioned policies."""
    info = {"pixels": frames(given["pixels"]), "goal": frames(given["goal"])}
    info |= {name: given[name] for name in ("proprio", "goal_proprio") if name in given}
    return {"action": model.get_action(info), "tokens": info["pixels_embed"]}


def agent(model: torch.nn.Module, given: Values) -> Values:
    """TD-MPC2 on states. An export calls the vector by its own column, of which there is one."""
    (name,) = model.extra_encoders.keys()
    latents = model.encode({name: given["state"]})
    state, steps = latents[:1].expand(4, -1), []
    for block in given["candidates"].unbind(1):
        state = model.dynamics(torch.cat([state, block], dim=-1))
        steps.append(state)
    return {
        "latents": latents,
        "prior": torch.tanh(model.pi(latents).chunk(2, dim=-1)[0]),
        "rollout": torch.stack(steps, dim=1),
        "cost": model.get_cost({name: given["state"][:1]}, given["candidates"][None])[0],
    }


def outputs(case: str, model: torch.nn.Module, given: Values) -> Values:
    """What the reference computes with the model of a case."""
    of = {"lewm": joint, "pldm": joint, "prejepa": tokens, "gcbc": policy, "gcivl": policy, "hilp": policy, "tdmpc2": agent}
    with torch.no_grad():
        return of[case.split("_")[0]](model, given)


def run(swm: str, *words: str) -> None:
    done = subprocess.run([swm, "--quiet", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"swm {' '.join(words)}\n{done.stderr}")


def export(swm: str, folder: Path, work: Path, given: Values) -> Path:
    """The case as a run and as an export of it."""
    file, words = CASES[folder.name]
    actions = given["action"] if "action" in given else given["candidates"]
    scales = ["--action-mean", "0,0", "--action-std", "1,1"]
    vector = next((given[name] for name in ("proprio", "state") if name in given), None)
    if vector is not None:
        dim = vector.shape[-1]
        scales += ["--proprio-mean", ",".join("0" * dim), "--proprio-std", ",".join("1" * dim)]
    assert actions.shape[-1] % 2 == 0, "swm/PushT-v1 has two actions"
    run(swm, "import", str(folder / file), "--env", "swm/PushT-v1", *scales, *words, "--out", str(work / "run"))
    generation = transformers.__version__.split(".")[0]
    run(swm, "export", str(work / "run"), "--out", str(work / "export"), "--transformers", generation)
    return work / "export"


def check(swm: str, folder: Path, work: Path) -> str:
    """A line about a case; ends the program where it differs."""
    expected = load_file(folder / "expected.safetensors")
    exported = export(swm, folder, work, expected)
    # An encoder in a folder of the export is found below the current one.
    with contextlib.chdir(exported):
        model = load_pretrained(str(exported)).eval()
    config = json.loads((exported / "config.json").read_text())
    worst = 0.0
    compared = outputs(folder.name, model, expected)
    for name, found in compared.items():
        if name not in expected:
            continue
        wanted = expected[name]
        if found.shape != wanted.shape:
            sys.exit(f"{folder.name}: {name} is {list(found.shape)}, not {list(wanted.shape)}")
        off = float(((found - wanted).abs() / (1 + wanted.abs())).max())
        worst = max(worst, off)
        if off > BOUND:
            sys.exit(f"{folder.name}: {name} differs by {off:.1e} of 1 + |x|")
        if name.endswith("cost") and int(found.argmin()) != int(wanted.argmin()):
            sys.exit(f"{folder.name}: another candidate is the cheapest")
    return f"{folder.name}: {config['_target_']}, {len(model.state_dict())} tensors, {len(compared)} outputs, largest difference {worst:.1e}"


def main() -> None:
    swm, checkpoints, work = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    for name in CASES:
        print(check(swm, checkpoints / name, work / name), flush=True)


if __name__ == "__main__":
    main()

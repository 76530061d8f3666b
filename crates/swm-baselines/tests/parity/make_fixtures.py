"""Makes the fixtures of `src/parity`: tiny networks of the reference with random weights, what they are given, what they
answer, losses, gradients, and weights after a step of AdamW.

Needs torch, transformers, safetensors and stable-worldmodel 0.1.1 from their packages:

    pip install torch transformers safetensors stable-worldmodel==0.1.1
    python make_fixtures.py [CASE ...]

A fixture is one safetensors file per case, its tensors in sections: `weights.`, `inputs.`, `outputs.`, `gradients.`,
`stepped.` (weights and running statistics after one step).
"""

import sys
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from stable_worldmodel.wm.lewm import LeWM
from stable_worldmodel.wm.lewm.module import MLP, Embedder, Predictor
from stable_worldmodel.wm.loss import PLDMLoss, SIGReg, TemporalStraighteningLoss
from torch import nn
from transformers import Dinov2Config, Dinov2Model, ViTConfig, ViTModel

HERE = Path(__file__).parent
ADAMW = dict(lr=0.01, betas=(0.9, 0.999), eps=1e-8, weight_decay=0.1)
CLIP = 0.5


def randomise(module: nn.Module) -> nn.Module:
    """Numbers that no default hides: zeros of AdaLN and ones of norms included."""
    with torch.no_grad():
        for tensor in module.parameters():
            tensor.normal_(0.0, 0.3)
        for name, tensor in module.named_buffers():
            if name.endswith("running_mean"):
                tensor.normal_(0.0, 0.3)
            if name.endswith("running_var"):
                tensor.uniform_(0.5, 1.5)
    return module


class Case:
    """Collects the sections of a fixture."""

    def __init__(self) -> None:
        self.tensors = {}

    def add(self, section: str, **named: torch.Tensor) -> None:
        for name, tensor in named.items():
            self.tensors[f"{section}.{name}"] = tensor.detach().clone().float().contiguous()

    def add_weights(self, section: str, module: nn.Module) -> None:
        self.add(section, **{k: v for k, v in module.state_dict().items() if is_read(k, v)})

    def add_gradients(self, module: nn.Module) -> None:
        for name, tensor in module.named_parameters():
            if tensor.grad is not None:
                self.add("gradients", **{name: tensor.grad})

    def save(self, name: str) -> None:
        path = HERE / f"{name}.safetensors"
        save_file(self.tensors, path)
        print(f"{path.name}: {path.stat().st_size} bytes")


def is_read(name: str, tensor: torch.Tensor) -> bool:
    """Not a counter, mask or unused token."""
    ends = ("num_batches_tracked", "mask_token", "causal_mask")
    is_mask = tensor.ndim == 4 and tensor.shape[:2] == (1, 1)
    return not name.endswith(ends) and not is_mask


def vit(image: int) -> ViTModel:
    config = ViTConfig(
        hidden_size=12, num_hidden_layers=2, num_attention_heads=3, intermediate_size=24, patch_size=4, image_size=image,
        hidden_dropout_prob=0.0, attention_probs_dropout_prob=0.0,
    )
    return ViTModel(config, add_pooling_layer=False)


def dinov2(image: int) -> Dinov2Model:
    config = Dinov2Config(
        hidden_size=12, num_hidden_layers=2, num_attention_heads=3, mlp_ratio=2, patch_size=4, image_size=image,
    )
    return Dinov2Model(config)


def encoders() -> None:
    """Both vision transformers, on pictures of the size of their positions and of another."""
    for name, make in (("vit", vit), ("dinov2", dinov2)):
        torch.manual_seed(1)
        case, model = Case(), randomise(make(16)).eval()
        case.add_weights("weights", model)
        for size in (16, 24):
            pictures = torch.randn(2, 3, size, size)
            output = model(pictures, interpolate_pos_encoding=True) if name == "vit" else model(pictures)
            output = output.last_hidden_state
            case.add("inputs", **{f"pictures{size}": pictures})
            case.add("outputs", **{f"tokens{size}": output})
            model.zero_grad()
            weights = torch.randn_like(output)
            case.add("inputs", **{f"weights{size}": weights})
            (output * weights).sum().backward()
        case.add_gradients(model)
        case.save(name)


WIDTH, FRAMES, ACTION = 12, 3, 4


def joint(extra: dict) -> LeWM:
    predictor = Predictor(
        num_frames=FRAMES, depth=2, heads=2, dim_head=5, mlp_dim=20, input_dim=WIDTH, hidden_dim=WIDTH, dropout=0.0,
    )
    model = LeWM(
        encoder=vit(16),
        predictor=predictor,
        action_encoder=Embedder(input_dim=ACTION, smoothed_dim=6, emb_dim=WIDTH),
        projector=MLP(WIDTH, 18, WIDTH, norm_fn=nn.BatchNorm1d),
        pred_proj=MLP(WIDTH, 18, WIDTH, norm_fn=nn.BatchNorm1d),
    )
    for name, module in extra.items():
        model.add_module(name, module)
    return randomise(model)


def predict(model: LeWM, pixels: torch.Tensor, action: torch.Tensor):
    output = model.encode({"pixels": pixels, "action": action})
    states, actions = output["emb"], output["act_emb"]
    return states, model.predict(states[:, :-1], actions[:, :-1])


def step(case: Case, model: nn.Module, loss: torch.Tensor) -> None:
    """Gradients, clipping and a step of AdamW."""
    optimiser = torch.optim.AdamW(model.parameters(), **ADAMW)
    optimiser.zero_grad()
    loss.backward()
    case.add_gradients(model)
    norm = nn.utils.clip_grad_norm_(model.parameters(), CLIP)
    optimiser.step()
    case.add("outputs", norm=norm.reshape(1))
    case.add_weights("stepped", model)


def batch(case: Case):
    pixels = torch.randint(0, 256, (5, FRAMES + 1, 3, 16, 16), dtype=torch.uint8)
    action = torch.randn(5, FRAMES + 1, ACTION)
    case.add("inputs", pixels=pixels, action=action)
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    normal = (pixels.float() / 255 - mean[:, None, None]) / deviation[:, None, None]
    return normal, action


def lewm() -> None:
    torch.manual_seed(2)
    case, model = Case(), joint({})
    case.add_weights("weights", model)
    pixels, action = batch(case)
    directions = torch.randn(WIDTH, 32)
    case.add("inputs", directions=directions)

    model.eval()
    states, predicted = predict(model, pixels, action)
    case.add("outputs", eval_states=states, eval_predicted=predicted)
    plans(case, model, pixels, action)

    model.train()
    states, predicted = predict(model, pixels, action)
    prediction = F.mse_loss(predicted, states[:, 1:])
    sigreg = SIGReg(num_proj=32)
    randn, torch.randn = torch.randn, lambda *shape, **_: directions.clone()
    normality = sigreg(states.transpose(0, 1))
    torch.randn = randn
    loss = prediction + 0.09 * normality
    case.add("outputs", states=states, predicted=predicted)
    case.add("outputs", prediction=prediction.reshape(1), sigreg=normality.reshape(1), total=loss.reshape(1))
    step(case, model, loss)
    case.save("lewm")


def plans(case: Case, model: LeWM, pixels: torch.Tensor, action: torch.Tensor) -> None:
    """Costs of candidates and their gradients, from one observation and from three."""
    for seen in (1, FRAMES):
        candidates = torch.randn(2, 6, 5, ACTION, requires_grad=True)
        case.add("inputs", **{f"candidates{seen}": candidates})
        past = action[:2, None, : seen - 1].expand(-1, 6, -1, -1)
        info = {"pixels": pixels[:2, None, :seen].expand(-1, 6, -1, -1, -1, -1)}
        goal = model.encode({"pixels": pixels[2:4, :1]})["emb"]
        end = model.rollout(info, torch.cat([past, candidates], dim=2))["predicted_emb"][:, :, -1]
        cost = (end - goal).square().sum(dim=-1)
        cost.sum().backward()
        case.add("outputs", **{f"costs{seen}": cost, f"costs{seen}_gradient": candidates.grad})


def pldm() -> None:
    torch.manual_seed(3)
    idm = MLP(2 * WIDTH, 16, ACTION)
    case, model = Case(), joint({"idm": idm})
    case.add_weights("weights", model)
    pixels, action = batch(case)
    model.train()
    states, predicted = predict(model, pixels, action)
    parts = {"prediction": F.mse_loss(predicted, states[:, 1:])}
    actions = idm(torch.cat([states[:, 1:], states[:, :-1]], dim=-1))
    terms = PLDMLoss()(states, actions, action[:, :-1])
    names = dict(std="std", std_t="std_t", cov="cov", cov_t="cov_t", alignment="temp_align", inverse="idm")
    parts |= {ours: terms[f"{theirs}_loss"] for ours, theirs in names.items()}
    parts["straightening"] = TemporalStraighteningLoss()(states)
    weights = dict(
        prediction=1.0, std=18.0, std_t=0.7, cov=12.0, cov_t=0.5, alignment=0.2, inverse=1.5, straightening=0.3
    )
    loss = sum(weights[name] * part for name, part in parts.items())
    case.add("outputs", total=loss.reshape(1), **{name: part.reshape(1) for name, part in parts.items()})
    step(case, model, loss)
    case.save("pldm")


CASES = dict(encoders=encoders, lewm=lewm, pldm=pldm)

if __name__ == "__main__":
    torch.set_num_threads(1)
    for name in sys.argv[1:] or CASES:
        CASES[name]()

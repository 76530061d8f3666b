"""Makes the fixtures of `src/parity`: tiny networks of the reference with random weights, what they are given, what they
answer, losses, gradients, and weights after a step of AdamW.

Needs torch, transformers, safetensors and stable-worldmodel 0.1.1 from their packages:

    pip install torch transformers safetensors stable-worldmodel==0.1.1
    python make_fixtures.py [CASE ...]

The case `generation4` needs transformers 4, whose names of tensors are others. `dinov2_small` makes an encoder of the published
size and no fixture: it writes into the folder that SWM_DINOV2_SMALL names, where the test of that name looks.

A fixture is one safetensors file per case, its tensors in sections: `weights.`, `inputs.`, `outputs.`, `gradients.`,
`stepped.` (weights and running statistics after one step).
"""

import os
import random
import sys
from pathlib import Path
from types import SimpleNamespace

import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from stable_worldmodel.wm.gcrl import GCRL
from stable_worldmodel.wm.gcrl import module as gcrl
from stable_worldmodel.wm.lewm import LeWM
from stable_worldmodel.wm.lewm.module import MLP, Embedder, Predictor
from stable_worldmodel.wm.loss import PLDMLoss, SIGReg, TemporalStraighteningLoss
from stable_worldmodel.wm.prejepa import PreJEPA
from stable_worldmodel.wm.prejepa import module as prejepa
from stable_worldmodel.wm.tdmpc2 import TDMPC2, tdmpc2_forward
from stable_worldmodel.wm.tdmpc2 import module as tdmpc2_module
from torch import nn
from transformers import Dinov2Config, Dinov2Model, ViTConfig, ViTModel

HERE = Path(__file__).parent
ADAMW = dict(lr=0.01, betas=(0.9, 0.999), eps=1e-8, weight_decay=0.1)
CLIP = 0.5


def randomize(module: nn.Module) -> nn.Module:
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


def vit(image: int, dim: int = 12) -> ViTModel:
    config = ViTConfig(
        hidden_size=dim, num_hidden_layers=2, num_attention_heads=3, intermediate_size=24, patch_size=4, image_size=image,
        hidden_dropout_prob=0.0, attention_probs_dropout_prob=0.0,
    )
    return ViTModel(config, add_pooling_layer=False)


def dinov2(image: int) -> Dinov2Model:
    config = Dinov2Config(
        hidden_size=12, num_hidden_layers=2, num_attention_heads=3, mlp_ratio=2, patch_size=4, image_size=image,
    )
    return Dinov2Model(config)


def encoders() -> None:
    """Both vision transformers, on images of the size of their positions and of another."""
    for name, make in (("vit", vit), ("dinov2", dinov2)):
        torch.manual_seed(1)
        case, model = Case(), randomize(make(16)).eval()
        case.add_weights("weights", model)
        for size in (16, 24):
            images = torch.randn(2, 3, size, size)
            output = model(images, interpolate_pos_encoding=True) if name == "vit" else model(images)
            output = output.last_hidden_state
            case.add("inputs", **{f"pictures{size}": images})
            case.add("outputs", **{f"tokens{size}": output})
            model.zero_grad()
            weights = torch.randn_like(output)
            case.add("inputs", **{f"weights{size}": weights})
            (output * weights).sum().backward()
        case.add_gradients(model)
        case.save(name)


def generation4() -> None:
    """Both vision transformers as transformers 4 names their tensors, in files of torch.save: a bare one and a trainer's."""
    for name, make in (("vit", vit), ("dinov2", dinov2)):
        torch.manual_seed(8)
        model = randomize(make(16)).eval()
        weights = model.state_dict()
        assert any(".attention.attention.query." in key for key in weights), "transformers 5 is installed; this needs 4"
        images = torch.randn(1, 3, 16, 16)
        case = Case()
        case.add("inputs", images=images)
        case.add("outputs", tokens=model(images).last_hidden_state)
        case.save(f"{name}_generation4")
        if name == "vit":
            torch.save(weights, HERE / "vit_generation4.pt")
        else:
            trained = {"epoch": 3, "state_dict": {f"model.{key}": value for key, value in weights.items()}, "lr": [0.1]}
            torch.save(trained, HERE / "dinov2_generation4.ckpt")


def dinov2_small() -> None:
    """The published size, weights as they are drawn, saved by transformers itself."""
    torch.manual_seed(9)
    config = Dinov2Config(
        hidden_size=384, num_hidden_layers=12, num_attention_heads=6, patch_size=14, image_size=518,
    )
    model = Dinov2Model(config).eval()
    folder = Path(os.environ["SWM_DINOV2_SMALL"])
    case = Case()
    with torch.no_grad():
        # Scales of branches begin at 1 and biases at 0: numbers that no default hides.
        for name, tensor in model.named_parameters():
            if tensor.ndim == 1:
                tensor.add_(torch.randn_like(tensor), alpha=0.1)
        model.save_pretrained(folder)
        for size in (70, 224):
            images = torch.randn(2, 3, size, size)
            case.add("inputs", **{f"pictures{size}": images})
            case.add("outputs", **{f"tokens{size}": model(images).last_hidden_state})
    save_file(case.tensors, folder / "case.safetensors")


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
    return randomize(model)


def predict(model: LeWM, pixels: torch.Tensor, action: torch.Tensor):
    output = model.encode({"pixels": pixels, "action": action})
    states, actions = output["emb"], output["act_emb"]
    return states, model.predict(states[:, :-1], actions[:, :-1])


def step(case: Case, model: nn.Module, loss: torch.Tensor) -> None:
    """Gradients, clipping and a step of AdamW."""
    optimizer = torch.optim.AdamW(model.parameters(), **ADAMW)
    optimizer.zero_grad()
    loss.backward()
    case.add_gradients(model)
    norm = nn.utils.clip_grad_norm_(model.parameters(), CLIP)
    optimizer.step()
    case.add("outputs", norm=norm.reshape(1))
    case.add_weights("stepped", model)


def normal(pixels: torch.Tensor) -> torch.Tensor:
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    return (pixels.float() / 255 - mean[:, None, None]) / deviation[:, None, None]


def batch(case: Case):
    pixels = torch.randint(0, 256, (5, FRAMES + 1, 3, 16, 16), dtype=torch.uint8)
    action = torch.randn(5, FRAMES + 1, ACTION)
    case.add("inputs", pixels=pixels, action=action)
    return normal(pixels), action


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


STATE = 3  # numbers of proprio


def dino_wm() -> None:
    """Images of 12 pixels: positions are interpolated from four by four patches to three by three."""
    torch.manual_seed(4)
    predictor = prejepa.CausalPredictor(
        num_patches=9, num_frames=FRAMES, dim=WIDTH + 4, depth=2, heads=2, mlp_dim=20, dim_head=5, dropout=0.0
    )
    encoders = nn.ModuleDict(
        {
            "proprio": prejepa.Embedder(in_chans=STATE, emb_dim=2),
            "action": prejepa.Embedder(in_chans=ACTION, emb_dim=2),
        }
    )
    model = PreJEPA(dinov2(16), predictor, encoders, history_size=FRAMES, interpolate_pos_encoding=False)
    case, model = Case(), randomize(model)
    model.backbone.requires_grad_(False)
    case.add_weights("weights", model)
    pixels = torch.randint(0, 256, (4, FRAMES + 1, 3, 12, 12), dtype=torch.uint8)
    action, proprio = torch.randn(4, FRAMES + 1, ACTION), torch.randn(4, FRAMES + 1, STATE)
    case.add("inputs", pixels=pixels, action=action, proprio=proprio)
    images = normal(pixels)

    frames = model.encode({"pixels": images, "action": action, "proprio": proprio})["emb"]
    predicted = model.predict(frames[:, :-1])
    loss = F.mse_loss(predicted[..., :-2], frames[:, 1:, :, :-2].detach())
    loss.backward()
    case.add("outputs", total=loss.reshape(1))
    case.add_gradients(model)

    model.eval()
    for seen in (1, FRAMES):
        candidates = torch.randn(2, 6, 4, ACTION, requires_grad=True)
        case.add("inputs", **{f"candidates{seen}": candidates})
        many = lambda tensor: tensor[:2, None, :seen].expand(-1, 6, *[-1] * (tensor.ndim - 1))
        info = {"pixels": many(images), "proprio": many(proprio)}
        past = action[:2, None, : seen - 1].expand(-1, 6, -1, -1)
        info = model.rollout(info, torch.cat([past, candidates], dim=2))
        goal = {"goal": images[2:4, :1], "goal_proprio": proprio[2:4, :1]}
        goal = model.encode(goal, pixels_key="goal", prefix="goal_", emb_keys=["proprio"], target="goal_emb")
        for name in ("pixels_goal_emb", "proprio_goal_emb"):
            info[name] = goal[name].unsqueeze(1).expand(-1, 6, *[-1] * (goal[name].ndim - 1))
        cost = model.criterion(info, None)
        cost.sum().backward()
        case.add("outputs", **{f"costs{seen}": cost, f"costs{seen}_gradient": candidates.grad})
        del model._init_cached_info
    case.save("dino_wm")


HISTORY = 2


class Pair(nn.Module):
    """A network and its teacher."""

    def __init__(self, make) -> None:
        super().__init__()
        self.student, self.teacher = make(), make()


def goal_batch(case: Case, steps: int, history: int = HISTORY):
    """Two of five clips stand at their goal: one in its first frame, one in its second."""
    pixels = torch.randint(0, 256, (5, steps, 3, 8, 8), dtype=torch.uint8)
    goals = torch.randint(0, 256, (5, 1, 3, 8, 8), dtype=torch.uint8)
    action, proprio = torch.randn(5, steps, ACTION), torch.randn(5, steps, STATE)
    goal_state = torch.randn(5, 1, STATE)
    for clip, step in ((0, 0), (3, 1)):
        goals[clip, 0], goal_state[clip, 0] = pixels[clip, step], proprio[clip, step]
    case.add("inputs", pixels=pixels, goal_pixels=goals, action=action, proprio=proprio, goal_proprio=goal_state)
    reached = (pixels == goals).all(dim=(2, 3, 4)) & (proprio == goal_state).all(dim=2)
    info = {"pixels": normal(pixels), "proprio": proprio, "goal": normal(goals), "goal_proprio": goal_state}
    return info, action, reached[:, :history, None].float()


def see(model: GCRL, info: dict):
    info = model.encode(dict(info), pixels_key="pixels", target="embed")
    info = model.encode(info, pixels_key="goal", prefix="goal_", target="goal_embed")
    return info["embed"], info["goal_embed"].flatten(1, 2)


def hilp_model() -> GCRL:
    """Tokens of 6 + 2 values, 4 of each frame, 3 frames."""
    sizes = dict(num_patches=4, num_frames=3, dim=8, depth=3, heads=2, mlp_dim=20, dim_head=5)
    model = GCRL(
        vit(8, 6),
        gcrl.Predictor(**sizes, out_dim=ACTION),
        Pair(lambda: gcrl.MetricValuePredictor(**sizes, embed_dim=5)),
        None,
        nn.ModuleDict({"proprio": gcrl.Embedder(in_chans=STATE, emb_dim=2)}),
        history_size=3,
    )
    return randomize(model)


def goal_model(value=None, critic=None) -> GCRL:
    sizes = dict(num_patches=4, num_frames=HISTORY, dim=WIDTH + 2, depth=3, heads=2, mlp_dim=20, dim_head=5)
    values = dict(sizes, pool_type="mean")
    model = GCRL(
        vit(8),
        gcrl.Predictor(**sizes, out_dim=ACTION),
        value and Pair(lambda: gcrl.Predictor(**values, out_dim=1)),
        critic and Pair(lambda: gcrl.QPredictor(**values, action_dim=ACTION, q_hidden_dim=9)),
        nn.ModuleDict({"proprio": gcrl.Embedder(in_chans=STATE, emb_dim=2)}),
        history_size=HISTORY,
    )
    return randomize(model)


def decide(case: Case, model: GCRL, info: dict, history: int = HISTORY) -> None:
    """The mean actions for the first frames."""
    info = dict(info, pixels=info["pixels"][:, :history], proprio=info["proprio"][:, :history])
    with torch.no_grad():
        case.add("outputs", act=model.get_action(info))


def finish(case: Case, model: nn.Module, name: str, loss: torch.Tensor) -> None:
    loss.backward()
    case.add("outputs", total=loss.reshape(1))
    case.add_gradients(model)
    case.save(name)


def gcbc() -> None:
    torch.manual_seed(5)
    case, model = Case(), goal_model()
    case.add_weights("weights", model)
    info, action, _ = goal_batch(case, HISTORY)
    decide(case, model, info)
    frames, goal = see(model, info)
    means = model.action_predictor(frames.flatten(1, 2), goal)
    finish(case, model, "gcbc", F.mse_loss(means, action))


def advantage_weighted(model: GCRL, now, after, goal, action, alpha: float) -> torch.Tensor:
    with torch.no_grad():
        value = model.value_predictor.student
        worth = torch.exp(alpha * (value(after, goal) - value(now, goal))).clamp(max=100.0)
    means = model.action_predictor(now.detach(), goal.detach())
    log_stds = model.log_stds.clamp(model.log_std_min, model.log_std_max)
    unlikely = log_stds + 0.5 * (action[:, : means.shape[1]] - means).square() / torch.exp(2 * log_stds)
    return (worth * unlikely).mean()


def value_learner(name: str, seed: int, critic: bool, alpha: float) -> None:
    """Both phases, each a fixture with weights of its own."""
    for phase in ("value", "policy"):
        torch.manual_seed(seed)
        case, model = Case(), goal_model(value=True, critic=critic)
        case.add_weights("weights", model)
        info, action, reached = goal_batch(case, HISTORY + 1)
        decide(case, model, info)
        frames, goal = see(model, info)
        now, after = frames[:, :HISTORY].flatten(1, 2), frames[:, 1:].flatten(1, 2)
        if phase == "policy":
            loss = advantage_weighted(model, now, after, goal, action, alpha)
        else:
            value = model.value_predictor.student(now, goal)
            with torch.no_grad():
                target = (1 - reached) * (0.99 * model.value_predictor.teacher(after, goal) - 1)
            expectile = gcrl.ExpectileLoss(tau=0.9)
            if critic:
                actions = action[:, :HISTORY]
                with torch.no_grad():
                    worth = model.critic_predictor.teacher(now, actions, goal)
                error = F.mse_loss(model.critic_predictor.student(now, actions, goal), target)
                loss = expectile(value, worth) + error
            else:
                loss = expectile(value, target)
        finish(case, model, f"{name}_{phase}", loss)


def gcivl() -> None:
    value_learner("gcivl", 6, critic=False, alpha=3.0)


def gciql() -> None:
    value_learner("gciql", 7, critic=True, alpha=10.0)


def hilp() -> None:
    """Both phases; the values of the first also by themselves, on given tokens."""
    for phase in ("value", "policy"):
        torch.manual_seed(10)
        case, model = Case(), hilp_model()
        case.add_weights("weights", model)
        info, action, reached = goal_batch(case, 4, history=3)
        decide(case, model, info, history=3)
        frames, goal = see(model, info)
        now, after = frames[:, :3].flatten(1, 2), frames[:, 1:].flatten(1, 2)
        if phase == "policy":
            loss = advantage_weighted(model, now, after, goal, action, 3.0)
        else:
            networks = model.value_predictor
            with torch.no_grad():
                target = (1 - reached) * (0.99 * networks.teacher(after, goal) - 1)
            value = networks.student(now, goal)
            loss = gcrl.ExpectileLoss(tau=0.9)(value, target)
            case.add("inputs", frames=frames[:, :3], goal=goal.unflatten(1, (1, 4)))
            case.add("outputs", values=value, value=value.mean().reshape(1))
        finish(case, model, f"hilp_{phase}", loss)


class SacPolicy(nn.Module):
    """SAC's networks by the names of Stable-Baselines3, observations of 3 values and actions of 2."""

    def __init__(self) -> None:
        super().__init__()
        actor = nn.Module()
        actor.latent_pi = nn.Sequential(nn.Linear(3, 7), nn.ReLU(), nn.Linear(7, 5), nn.ReLU())
        actor.mu, actor.log_std = nn.Linear(5, 2), nn.Linear(5, 2)
        self.actor, self.critic, self.critic_target = actor, self.twin(), self.twin()
        self.log_ent_coef = nn.Parameter(torch.zeros(1))

    @staticmethod
    def twin() -> nn.Module:
        twin = nn.Module()
        for name in ("qf0", "qf1"):
            layers = nn.Linear(5, 7), nn.ReLU(), nn.Linear(7, 5), nn.ReLU(), nn.Linear(5, 1)
            setattr(twin, name, nn.Sequential(*layers))
        return twin

    def sample(self, observation: torch.Tensor, noise: torch.Tensor):
        hidden = self.actor.latent_pi(observation)
        mean, log_std = self.actor.mu(hidden), self.actor.log_std(hidden).clamp(-20, 2)
        gaussian = mean + log_std.exp() * noise
        action = torch.tanh(gaussian)
        density = torch.distributions.Normal(mean, log_std.exp()).log_prob(gaussian).sum(dim=1)
        return action, (density - torch.log(1 - action**2 + 1e-6).sum(dim=1)).reshape(-1, 1)


def values(twin: nn.Module, observation: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    both = torch.cat([observation, action], dim=1)
    return torch.cat([twin.qf0(both), twin.qf1(both)], dim=1)


def sac() -> None:
    """Losses and gradients of critics and policy at the first weights, and all weights after one update of Stable-Baselines3's
    `SAC.train`: temperature, critics, policy, target networks."""
    torch.manual_seed(11)
    case, model = Case(), randomize(SacPolicy())
    mean, var = torch.randn(3), torch.rand(3) + 0.5
    case.add_weights("weights", model)
    case.add("weights.observation", running_mean=mean, running_var=var, running_count=torch.tensor([40.0]))
    observation, action, noise = torch.randn(6, 2, 3), torch.rand(6, 2, 2) * 2 - 1, torch.randn(2, 6, 2)
    observation[0, 0, 0] = 50.0  # clipped
    reward, terminated = torch.randn(6, 2), torch.zeros(6, 2)
    terminated[2, 1] = 1.0
    case.add("inputs", observation=observation, action=action, reward=reward, terminated=terminated, noise=noise)
    now, after = ((observation - mean) / torch.sqrt(var + 1e-8)).clamp(-10, 10).unbind(1)

    ent_coef = model.log_ent_coef.exp().detach()

    def critic_loss() -> torch.Tensor:
        with torch.no_grad():
            following, density = model.sample(after, noise[1])
            soft = values(model.critic_target, after, following).min(dim=1, keepdim=True).values - ent_coef * density
            target = reward[:, 1:] + (1 - terminated[:, 1:]) * 0.99 * soft
        q = values(model.critic, now, action[:, 0])
        return 0.5 * sum(F.mse_loss(q[:, i : i + 1], target) for i in range(2))

    def actor_loss() -> torch.Tensor:
        chosen, density = model.sample(now, noise[0])
        return (ent_coef * density - values(model.critic, now, chosen).min(dim=1, keepdim=True).values).mean()

    for part, loss in (("critic", critic_loss()), ("actor", actor_loss())):
        module = getattr(model, part)
        names, tensors = zip(*module.named_parameters())
        case.add("outputs", **{part: loss.reshape(1)})
        gradients = torch.autograd.grad(loss, tensors)
        case.add("gradients", **{f"{part}.{name}": gradient for name, gradient in zip(names, gradients)})

    adam = lambda parameters: torch.optim.Adam(parameters, lr=0.01)
    optimizers = adam([model.log_ent_coef]), adam(model.critic.parameters()), adam(model.actor.parameters())

    def temperature_loss() -> torch.Tensor:
        with torch.no_grad():
            _, density = model.sample(now, noise[0])
        return -(model.log_ent_coef * (density - 2.0)).mean()

    for optimizer, loss in zip(optimizers, (temperature_loss, critic_loss, actor_loss)):
        optimizer.zero_grad()
        loss().backward()
        optimizer.step()
    with torch.no_grad():
        for target, online in zip(model.critic_target.parameters(), model.critic.parameters()):
            target.mul_(1 - 0.005).add_(online, alpha=0.005)
    case.add_weights("stepped", model)
    case.save("sac")


class Settings(dict):
    """Settings that are read as attributes, as OmegaConf's are."""

    __getattr__ = dict.__getitem__


def tdmpc2() -> None:
    """The functions of TD-MPC2; its losses, gradients and scale with given noise and pairs of Qs; weights after one update; costs of
    plans. Dropout is off. Two steps, three Qs, observations of 3 values and actions of 2."""
    torch.manual_seed(12)
    steps, clips, qs, actions = 2, 5, 3, 2
    wm = Settings(
        horizon=steps, mlp_dim=6, enc_dim=7, simnorm_dim=4, num_q=qs, rho=0.5, tau=0.01, consistency_coef=20.0, reward_coef=0.1,
        value_coef=0.1, discount=0.97, uncertainty_penalty=0.5, entropy_coef=1e-4, num_bins=11, vmin=-3, vmax=3,
        encoding={"observation": 8},
    )
    cfg = Settings(wm=wm, action_dim=actions, extra_dims={"observation": 3})
    case, model = Case(), TDMPC2(cfg).eval()
    randomize(model)
    case.add_weights("weights", model)

    values = torch.tensor([0.0, 0.3, -0.3, 2.5, -7.0, 15.0, 40.0, -40.0]).reshape(-1, 1)
    inside = values[:6]  # At the upper bound the reference fills the last bin but one.
    logits, latent = torch.randn(6, 11), torch.randn(4, 8)
    mean, gaussian, log_density = torch.randn(4, 2), torch.randn(4, 2), torch.randn(4, 1)
    case.add("inputs", values=values, inside=inside, logits=logits, latent=latent)
    case.add("inputs", mean=mean, gaussian=gaussian, log_density=log_density)
    _, action, density = tdmpc2_module.squash(mean, gaussian, log_density)
    case.add(
        "outputs", symlog=tdmpc2_module.symlog(values), symexp=tdmpc2_module.symexp(values / 8),
        two_hot=tdmpc2_module.two_hot(inside, cfg), two_hot_inverse=tdmpc2_module.two_hot_inv(logits, cfg),
        simnorm=model.sim_norm(latent), mish=F.mish(logits * 8), log_std=tdmpc2_module.log_std(mean), action=action, density=density,
    )

    observation, action = torch.randn(clips, steps + 1, 3), torch.rand(clips, steps + 1, actions) * 2 - 1
    reward = torch.randn(clips, steps + 1)
    noise = torch.randn(2 * steps, clips, actions)
    pairs = [random.Random(12 + index).sample(range(qs), 2) for index in range(2 * steps)]
    # Of the clips here, a reward comes with the observation after its action.
    case.add("inputs", observation=observation, action=action, reward=reward.roll(1, dims=1), noise=noise)
    case.add("inputs", pairs=torch.tensor(pairs))
    with torch.no_grad():
        case.add("outputs", encoded=model.encode({"observation": observation[:, 0]}))

        candidates = torch.rand(2, 6, 3, actions) * 2 - 1
        seen = observation[:2, None, 0].expand(-1, 6, -1)
        case.add("inputs", candidates=candidates)
        case.add("outputs", costs=model.get_cost({"observation": seen}, candidates))

    batch = dict(observation=observation, action=action, reward=reward)
    tdmpc2_update(case, model, cfg, batch, noise, pairs)
    case.save("tdmpc2")


def tdmpc2_update(case: Case, model: TDMPC2, cfg: "Settings", batch: dict, noise: torch.Tensor, pairs: list) -> None:
    """Losses, scale, gradients with given noise and pairs of Qs, and weights after one update."""
    names = dict(consist="consistency_loss", reward="reward_loss", value="value_loss", policy="policy_loss", loss="total")
    logged = {}
    context = SimpleNamespace(model=model, log_dict=lambda terms, **_: logged.update(terms))
    given_noise, given_pairs = iter(noise), iter(pairs)
    randn_like, sample = torch.randn_like, random.sample
    torch.randn_like, random.sample = lambda _: next(given_noise), lambda *_: next(given_pairs)
    loss = tdmpc2_forward(context, batch, "train", cfg)["loss"]
    torch.randn_like, random.sample = randn_like, sample
    case.add("outputs", **{ours: logged[f"train/{theirs}"].reshape(1) for theirs, ours in names.items()})
    case.add("outputs", scale=model.scale.value)
    loss.backward()
    case.add_gradients(model)

    adam = lambda modules, lr, eps=1e-8: torch.optim.Adam([p for m in modules for p in m.parameters()], lr=lr, eps=eps)
    encoders = [getattr(model, name) for name in ("cnn", "pixel_encoder", "extra_encoders") if hasattr(model, name)]
    optimizers = (
        adam(encoders, 0.3 * 0.01), adam([model.dynamics, model.reward, model.qs], 0.01), adam([model.pi], 0.1 * 0.01, eps=1e-5),
    )
    case.add("outputs", norm=nn.utils.clip_grad_norm_(model.parameters(), CLIP).reshape(1))
    for optimizer in optimizers:
        optimizer.step()
    case.add_weights("stepped", model)


def tdmpc2_pixels() -> None:
    """TD-MPC2 from images and vectors: latents, losses, gradients and scale, weights after one update, costs of plans. Images are a
    function of the place of a byte, which the test computes, too; they are normalized as the reference's training script does. The
    module makes convolutions of 32 channels: here they have 3."""
    torch.manual_seed(13)
    steps, clips, qs, actions, side, channels = 2, 5, 3, 2, 39, 3
    wm = Settings(
        horizon=steps, mlp_dim=6, enc_dim=7, simnorm_dim=4, num_q=qs, rho=0.5, tau=0.01, consistency_coef=20.0, reward_coef=0.1,
        value_coef=0.1, discount=0.97, uncertainty_penalty=0.5, entropy_coef=1e-4, num_bins=11, vmin=-3, vmax=3,
        encoding={"pixels": 8, "observation": 8},
    )
    cfg = Settings(wm=wm, action_dim=actions, extra_dims={"observation": 3}, image_size=side)
    conv = nn.Conv2d
    nn.Conv2d = lambda inputs, outputs, size, stride: conv(min(inputs, channels), min(outputs, channels), size, stride=stride)
    case, model = Case(), TDMPC2(cfg).eval()
    nn.Conv2d = conv
    randomize(model)
    case.add_weights("weights", model)

    place = torch.arange(clips * (steps + 1) * side * side * 3, dtype=torch.int64)
    images = ((place * 2654435761) % 2**32 >> 24).reshape(clips, steps + 1, side, side, 3).movedim(-1, -3)
    mean, std = (torch.tensor(values).reshape(3, 1, 1) for values in ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]))
    pixels = (images.float() / 255 - mean) / std
    observation, action = torch.randn(clips, steps + 1, 3), torch.rand(clips, steps + 1, actions) * 2 - 1
    reward, noise = torch.randn(clips, steps + 1), torch.randn(2 * steps, clips, actions)
    pairs = [random.Random(13 + index).sample(range(qs), 2) for index in range(2 * steps)]
    case.add("inputs", observation=observation, action=action, reward=reward.roll(1, dims=1), noise=noise)
    case.add("inputs", pairs=torch.tensor(pairs))
    with torch.no_grad():
        case.add("outputs", encoded=model.encode({"pixels": pixels[:, 0], "observation": observation[:, 0]}))
        candidates = torch.rand(2, 6, 3, actions) * 2 - 1
        seen = {"pixels": pixels[:2, 0], "observation": observation[:2, 0]}
        case.add("inputs", candidates=candidates)
        case.add("outputs", costs=model.get_cost(seen, candidates))

    batch = dict(pixels=pixels, observation=observation, action=action, reward=reward)
    tdmpc2_update(case, model, cfg, batch, noise, pairs)
    case.save("tdmpc2_pixels")


CASES = dict(
    encoders=encoders, lewm=lewm, pldm=pldm, dino_wm=dino_wm, gcbc=gcbc, gcivl=gcivl, gciql=gciql, hilp=hilp,
    sac=sac, tdmpc2=tdmpc2, tdmpc2_pixels=tdmpc2_pixels,
)

# Made when they are named only.
OTHERS = dict(generation4=generation4, dinov2_small=dinov2_small)

if __name__ == "__main__":
    torch.set_num_threads(1)
    for name in sys.argv[1:] or CASES:
        (CASES | OTHERS)[name]()

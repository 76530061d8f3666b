"""LeWM's `paper` network in plain PyTorch, to time beside ours: the same layers and sizes, random weights and data.

Its training step and its plans are what `proof.py` measures; it is no reference for values, which `crates/swm-baselines/tests/parity` holds.
"""

import time

import torch
import torch.nn.functional as F
from torch import nn

DIM, ACTION, FRAMES, BLOCKS = 192, 10, 4, 5


class Attention(nn.Module):
    def __init__(self, heads, head_dim, dropout=0.0):
        super().__init__()
        self.heads, self.dropout = heads, dropout
        self.qkv, self.out = nn.Linear(DIM, 3 * heads * head_dim), nn.Linear(heads * head_dim, DIM)

    def forward(self, x, causal=False):
        q, k, v = self.qkv(x).unflatten(-1, (3, self.heads, -1)).permute(2, 0, 3, 1, 4)
        rate = self.dropout if self.training else 0.0
        return self.out(F.scaled_dot_product_attention(q, k, v, dropout_p=rate, is_causal=causal).transpose(1, 2).flatten(2))


def feed_forward(hidden, dropout=0.0):
    return nn.Sequential(nn.Linear(DIM, hidden), nn.GELU(), nn.Dropout(dropout), nn.Linear(hidden, DIM), nn.Dropout(dropout))


class Encoder(nn.Module):
    """ViT-tiny with patches of 14 pixels: [N, 3, S, S] to [N, DIM]."""

    def __init__(self, image, depth=12):
        super().__init__()
        self.patches = nn.Conv2d(3, DIM, 14, stride=14)
        self.token = nn.Parameter(torch.randn(1, 1, DIM) * 0.02)
        self.positions = nn.Parameter(torch.randn(1, (image // 14) ** 2 + 1, DIM) * 0.02)
        self.norms = nn.ModuleList(nn.LayerNorm(DIM) for _ in range(2 * depth + 1))
        self.attention = nn.ModuleList(Attention(3, 64) for _ in range(depth))
        self.mlp = nn.ModuleList(feed_forward(768) for _ in range(depth))

    def forward(self, pixels):
        x = self.patches(pixels).flatten(2).transpose(1, 2)
        x = torch.cat([self.token.expand(len(x), -1, -1), x], 1) + self.positions
        for i, (attention, mlp) in enumerate(zip(self.attention, self.mlp)):
            x = x + attention(self.norms[2 * i](x))
            x = x + mlp(self.norms[2 * i + 1](x))
        return self.norms[-1](x)[:, 0]


class Predictor(nn.Module):
    """A causal transformer with AdaLN-zero: [B, T, DIM] states and embedded actions to [B, T, DIM]."""

    def __init__(self, depth=6):
        super().__init__()
        self.positions = nn.Parameter(torch.randn(1, FRAMES - 1, DIM))
        self.plain, self.norm = nn.LayerNorm(DIM, 1e-6, elementwise_affine=False), nn.LayerNorm(DIM)
        self.attention = nn.ModuleList(Attention(16, 64, 0.1) for _ in range(depth))
        self.mlp = nn.ModuleList(feed_forward(2048, 0.1) for _ in range(depth))
        self.modulation = nn.ModuleList(nn.Linear(DIM, 6 * DIM) for _ in range(depth))

    def forward(self, states, actions):
        x = states + self.positions[:, : states.shape[1]]
        for attention, mlp, modulation in zip(self.attention, self.mlp, self.modulation):
            shift_a, scale_a, gate_a, shift_m, scale_m, gate_m = modulation(F.silu(actions)).chunk(6, -1)
            x = x + gate_a * attention(self.plain(x) * (1 + scale_a) + shift_a, causal=True)
            x = x + gate_m * mlp(self.plain(x) * (1 + scale_m) + shift_m)
        return self.norm(x)


class Projector(nn.Module):
    def __init__(self, hidden=2048):
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(DIM, hidden), nn.BatchNorm1d(hidden), nn.GELU(), nn.Linear(hidden, DIM))

    def forward(self, x):
        return self.layers(x.flatten(0, 1)).view_as(x)


class LeWM(nn.Module):
    def __init__(self, image):
        super().__init__()
        self.encoder, self.predictor = Encoder(image), Predictor()
        self.projector, self.pred_proj = Projector(), Projector()
        self.actions = nn.Sequential(nn.Linear(ACTION, 10), nn.Linear(10, 4 * DIM), nn.SiLU(), nn.Linear(4 * DIM, DIM))

    def predict(self, states, actions):
        return self.pred_proj(self.predictor(states, actions))


def sigreg(states, projections=1024, knots=17):
    directions = F.normalize(torch.randn(DIM, projections, device=states.device), dim=0)
    t = torch.linspace(0, 3, knots, device=states.device)
    window = torch.exp(-t * t / 2)
    weights = torch.full_like(t, 2 * 3 / (knots - 1)) * window
    weights[[0, -1]] /= 2
    angle = (states.float() @ directions)[..., None] * t
    error = (angle.cos().mean(0) - window).square() + angle.sin().mean(0).square()
    return (error @ weights).mean() * len(states)


def training(model, batch, image, device, autocast):
    """A step of `batch` clips whose pixels are bytes on the host, as a loader gives them."""
    optimizer = torch.optim.AdamW(model.parameters(), 5e-5, weight_decay=1e-3)
    pixels = torch.randint(0, 256, (batch, FRAMES, 3, image, image), dtype=torch.uint8)
    actions = torch.randn(batch, FRAMES, ACTION, device=device)
    pixels = pixels.pin_memory() if device != "cpu" else pixels
    model.train()

    def step():
        frames = pixels.to(device, non_blocking=True).flatten(0, 1).float() / 127.5 - 1
        with torch.autocast(torch.device(device).type, torch.bfloat16, enabled=autocast):
            states = model.projector(model.encoder(frames).unflatten(0, (batch, FRAMES)))
            predicted = model.predict(states[:, :-1], model.actions(actions)[:, :-1])
        loss = F.mse_loss(predicted.float(), states[:, 1:].float()) + 0.09 * sigreg(states)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        return loss.item()

    return step


def planning(model, samples, iterations, device):
    """A plan by the cross-entropy method: the costs of `samples` plans of BLOCKS blocks, in each iteration."""
    start, goal = torch.randn(1, 1, DIM, device=device), torch.randn(DIM, device=device)
    model.eval()

    @torch.no_grad()
    def plan():
        mean, std = torch.zeros(BLOCKS, ACTION, device=device), torch.ones(BLOCKS, ACTION, device=device)
        for _ in range(iterations):
            plans = mean + std * torch.randn(samples, BLOCKS, ACTION, device=device)
            actions, states = model.actions(plans), start.expand(samples, -1, -1)
            for t in range(BLOCKS):
                first = max(0, t + 2 - FRAMES)
                states = torch.cat([states, model.predict(states[:, first:], actions[:, first : t + 1])[:, -1:]], 1)
            cost = (states[:, -1] - goal).square().sum(-1)
            elites = plans[cost.topk(max(2, samples // 10), largest=False).indices]
            mean, std = elites.mean(0), elites.std(0)
        return mean.sum().item()

    return plan


def seconds(work, repeats):
    """The median of the time of a call, after two that warm up. Each call ends with a value on the host."""
    work(), work()
    times = []
    for _ in range(repeats):
        before = time.perf_counter()
        work()
        times.append(time.perf_counter() - before)
    return sorted(times)[len(times) // 2]


def measure(device, batch, image, samples, iterations, repeats):
    """Seconds of a training step in float32 and under autocast to bfloat16, and of a plan."""
    model = LeWM(image).to(device)
    return {
        "torch": torch.__version__,
        "step_s": seconds(training(model, batch, image, device, False), repeats),
        "step_bf16_s": seconds(training(model, batch, image, device, True), repeats),
        "plan_s": seconds(planning(model, samples, iterations, device), repeats),
    }

"""The torch module of the baseline `canonical`: drawings of a run by its formulas, and what is no run of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from stable_worldmodel_rs import wm  # noqa: E402

SIDE, COUNT, CHANNELS = 16, 4, (8, 6, 7)
# As the Rust model names them.
SETTINGS: dict[str, Any] = {"image": SIDE, "channels": list(CHANNELS), "frames": 2, "clip": 2, "frameskip": 1, "batch": 8}
IMAGENET = np.array([[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]])


def shapes(frames: int = 2) -> dict[str, tuple[int, ...]]:
    """Of the tensors of a run, by the names that they have in its files."""
    half, quarter, eighth = CHANNELS
    layers = {
        **{"half": (half, 8 + 3 * (frames - 1), 5), "quarter": (quarter, half, 3), "quarter_again": (quarter, quarter, 3)},
        **{"eighth": (eighth, quarter, 3), "eighth_again": (eighth, eighth, 3), "up_to_quarter": (quarter, eighth + quarter, 3)},
        "up_to_half": (half, quarter + half, 3),
    }
    found: dict[str, tuple[int, ...]] = {"background.mean": (3, SIDE, SIDE), "background.std": (1,)}
    for name, (outputs, inputs, size) in layers.items():
        found |= {f"network.{name}.weight": (outputs, inputs, size, size), f"network.{name}.bias": (outputs,)}
    return found | {"network.blocks.weight": (12, half), "network.blocks.bias": (12,)}


def random_weights(frames: int = 2) -> dict[str, Any]:
    stream = np.random.RandomState(frames)
    found = {name: stream.standard_normal(shape).astype(np.float32) * 0.3 for name, shape in shapes(frames).items()}
    found["background.std"] = np.float32([0.8])
    return found


def write_safetensors(path: Path, tensors: dict[str, Any]) -> None:
    header: dict[str, Any] = {}
    end = 0
    for name, values in tensors.items():
        header[name] = {"dtype": "F32", "shape": list(values.shape), "data_offsets": [end, end + values.nbytes]}
        end += values.nbytes
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + b"".join(values.tobytes() for values in tensors.values()))


def run_of(folder: Path, changes: dict[str, Any] | None = None, frames: int = 2) -> Path:
    """A run as the Rust program writes one: its config, and the weights of two steps."""
    (folder / "checkpoints").mkdir(parents=True)
    model = {"baseline": "canonical", "preset": "small", "settings": {"model": SETTINGS | {"frames": frames}}, "seed": 1}
    (folder / "config.json").write_text(json.dumps({"version": 1, "model_config": model | (changes or {})}))
    for step in (9, 40):
        weights = random_weights(frames)
        weights["background.mean"] *= step / 40
        write_safetensors(folder / "checkpoints" / f"step-{step}.safetensors", weights)
    (folder / "checkpoints" / "step-40.training.safetensors").write_text("of the optimizer")
    return folder


def images() -> tuple[Any, Any]:
    """Images, and those beside them: ``(COUNT, SIDE, SIDE, 3)`` bytes each."""
    stream = np.random.RandomState(5)
    first, second = (torch.from_numpy(stream.randint(0, 256, (COUNT, SIDE, SIDE, 3)).astype(np.uint8)) for _ in range(2))
    return first, second


def levels(found: Any, wanted: Any) -> int:
    return int((found.int() - wanted.int()).abs().max())


@pytest.mark.parametrize("frames", [1, 2])
def test_drawings_of_a_run_are_those_of_the_formulas(frames: int, tmp_path: Path) -> None:
    model = wm.load_canonical(run_of(tmp_path / "run", frames=frames))
    assert not model.training and (model.image, model.frames) == (SIDE, frames)
    own, beside = images()
    found = model.draw(own, beside)
    assert found.dtype == torch.uint8 and found.shape == own.shape
    weights = {name.replace("network.half.", "network.to_half."): value.astype(np.float64) for name, value in random_weights(frames).items()}
    for index in range(COUNT):
        seen, other = ((values[index].numpy() / 255 - IMAGENET[0]) / IMAGENET[1] for values in (own, beside))
        drawn = by_formula(seen, other, weights, frames) * IMAGENET[1] + IMAGENET[0]
        wanted = torch.from_numpy(np.floor(drawn * 255 + 0.5).clip(0, 255))
        assert levels(found[index], wanted) <= 1
    assert found.max() - found.min() > 100  # It draws something.
    # Channels first, axes before the images, and one goal beside several observations.
    assert levels(model.draw(own.movedim(-1, -3), beside.movedim(-1, -3)), found) <= 1
    assert levels(model.draw(own[:, None], beside[:, None]), found[:, None]) <= 1
    assert levels(model.draw(own[None], beside[None, :1])[0, 0], found[0]) <= 1
    # What is beside an image is seen by two frames alone.
    assert (levels(model.draw(own, own), found) > 1) == (frames == 2)


def convolved(maps: Any, weight: Any, bias: Any, stride: int) -> Any:
    """A convolution and a ReLU of maps ``(H, W, in)`` by its formula."""
    outputs, _, size, _ = weight.shape
    padding = -(-(size - stride) // 2)
    padded = np.pad(maps, ((padding, padding), (padding, padding), (0, 0)))
    rows, columns = ((length + 2 * padding - size) // stride + 1 for length in maps.shape[:2])
    out = np.empty((rows, columns, outputs))
    for row in range(rows):
        for column in range(columns):
            patch = padded[row * stride : row * stride + size, column * stride : column * stride + size]
            out[row, column] = np.einsum("yxi,oiyx->o", patch, weight) + bias
    return np.maximum(out, 0)


def by_formula(image: Any, other: Any, weights: dict[str, Any], frames: int) -> Any:
    """The drawing of one standardized image ``(S, S, 3)``, in float64."""
    side = len(image)
    mean = image.mean((0, 1))
    apart = image - mean
    std = np.sqrt((apart**2).mean((0, 1))) + 0.1
    place = (2 * np.arange(side) + 1) / side - 1
    where = np.stack(np.meshgrid(place, place), -1)
    seen = np.concatenate([image, apart / std, where] + ([(other - mean) / std] if frames == 2 else []), -1)

    def layer(name: str, maps: Any, stride: int) -> Any:
        return convolved(maps, weights[f"network.{name}.weight"], weights[f"network.{name}.bias"], stride)

    def up(coarse: Any, fine: Any) -> Any:
        return np.concatenate([coarse.repeat(2, 0).repeat(2, 1), fine], -1)

    half = layer("to_half", seen, 2)
    quarter = layer("quarter_again", layer("quarter", half, 2), 1)
    eighth = layer("eighth_again", layer("eighth", quarter, 2), 1)
    quarter = layer("up_to_quarter", up(eighth, quarter), 1)
    half = layer("up_to_half", up(quarter, half), 1)
    blocks = half @ weights["network.blocks.weight"].T + weights["network.blocks.bias"]
    rows = len(half)
    drawn = blocks.reshape(rows, rows, 2, 2, 3).transpose(0, 2, 1, 3, 4).reshape(side, side, 3)
    return drawn * weights["background.std"] + weights["background.mean"].transpose(1, 2, 0)


@pytest.mark.parametrize("frames", [1, 2])
def test_the_network_is_that_of_its_formulas(frames: int) -> None:
    stream = np.random.RandomState(frames)
    model = wm.Canonical(image=24, channels=(3, 5, 4), frames=frames).eval()
    state = {name: stream.standard_normal(tuple(value.shape)) * 0.3 for name, value in model.state_dict().items()}
    model.load_state_dict({name: torch.from_numpy(value).float() for name, value in state.items()})
    images, others = (stream.standard_normal((2, 24, 24, 3)) for _ in range(2))
    given = [torch.from_numpy(values).float().movedim(-1, 1) for values in (images, others)]
    with torch.no_grad():
        found = model(*given).movedim(1, -1).numpy()
    for index in range(2):
        wanted = by_formula(images[index], others[index], state, frames)
        assert np.abs(found[index] - wanted).max() < 1e-4


def test_gradients_flow_and_it_learns() -> None:
    torch.manual_seed(0)
    model = wm.Canonical(image=16, channels=(8, 8, 8), frames=1)
    images = torch.randn(4, 3, 16, 16)
    optimizer = torch.optim.Adam(model.parameters(), 1e-2)
    losses: list[float] = []
    for _ in range(30):
        loss = (model(images) - images.flip(1)).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.8 * losses[0]


def test_a_checkpoint_is_chosen(tmp_path: Path) -> None:
    folder = run_of(tmp_path / "run")
    last, first = (wm.load_canonical(folder, checkpoint=step).background.mean for step in (40, 9))
    assert torch.equal(wm.load_canonical(folder).background.mean, last) and not torch.equal(first, last)
    with pytest.raises(FileNotFoundError, match="no checkpoint of step 7; it has 9, 40"):
        wm.load_canonical(folder, checkpoint=7)
    for path in (folder / "checkpoints").glob("step-*.safetensors"):
        path.unlink()
    with pytest.raises(FileNotFoundError, match="the run has not saved one yet"):
        wm.load_canonical(folder)


def test_what_is_no_run_of_it_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no config.json: it is no run; `swm train canonical --out"):
        wm.load_canonical(tmp_path)
    with pytest.raises(TypeError, match="the run is NoneType; give the folder"):
        wm.load_canonical(None)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="is a run of lewm, and load_canonical reads those of canonical"):
        wm.load_canonical(run_of(tmp_path / "a", {"baseline": "lewm"}))
    with pytest.raises(ValueError, match="network.eighth.weight, .* are not of the network in config.json"):
        wm.load_canonical(run_of(tmp_path / "b", {"settings": {"model": SETTINGS | {"channels": [8, 6, 12]}}}))
    for name, value, message in [("image", 20, "must be a multiple of 8"), ("frames", 3, "1 frame or 2"), ("channels", [8, 0, 8], "three numbers")]:
        with pytest.raises(ValueError, match=message):
            wm.load_canonical(run_of(tmp_path / name, {"settings": {"model": SETTINGS | {name: value}}}))
    (tmp_path / "config.json").write_text("[1]")
    with pytest.raises(ValueError, match="is no config of a run"):
        wm.load_canonical(tmp_path)


def test_wrong_images_are_named(tmp_path: Path) -> None:
    model, (own, beside) = wm.load_canonical(run_of(tmp_path / "run")), images()
    with pytest.raises(ValueError, match="sees two frames; give the second"):
        model.draw(own)
    with pytest.raises(TypeError, match="images are torch.float32; draw takes bytes"):
        model.draw(own.float(), beside)
    with pytest.raises(ValueError, match=r"\[4, 3, 16, 16\] images beside \[2, 3, 16, 16\] others"):
        model(torch.zeros(4, 3, 16, 16), torch.zeros(2, 3, 16, 16))
    with pytest.raises(ValueError, match="sides are multiples of 8"):
        model(torch.zeros(1, 3, 12, 12), torch.zeros(1, 3, 12, 12))
    larger = torch.nn.functional.interpolate(own.movedim(-1, 1).float(), size=(48, 48)).byte()
    assert model.draw(larger, larger).shape == (4, 16, 16, 3)

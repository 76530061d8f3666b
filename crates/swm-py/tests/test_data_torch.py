"""Datasets in torch's ``DataLoader``, and the loader's tensors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_worldmodel_rs as swm
from data_makers import write

torch = pytest.importorskip("torch")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path / "toy.h5", lengths=(10, 7, 12))


def test_items_are_tensors(path: Path) -> None:
    item = swm.data.load_dataset(path, num_steps=2, frameskip=2)[0]
    types = {key: value.dtype for key, value in item.items() if isinstance(value, torch.Tensor)}
    assert types == {
        "pixels": torch.uint8,
        "action": torch.float32,
        "state": torch.float64,
        "reward": torch.float64,
        "done": torch.bool,
        "count": torch.int64,
    }
    assert item["env_name"] == "toy0" and item["pixels"].shape == (2, 3, 32, 32)


@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
@pytest.mark.parametrize("collate", [None, swm.data.collate])
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_workers(path: Path, method: str, collate: Any) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2)
    dataset.__getitems__([0, 1, 2])
    for workers in (0, 2):
        context = method if workers else None
        loader = torch.utils.data.DataLoader(
            dataset, batch_size=4, num_workers=workers, multiprocessing_context=context, collate_fn=collate
        )
        batches = list(loader)
        states = torch.cat([batch["state"] for batch in batches])
        wanted = torch.stack([dataset[index]["state"] for index in range(len(dataset))])
        assert torch.equal(states, wanted)
        assert batches[0]["env_name"] == ["toy0"] * 4


def test_splits_of_torch(path: Path) -> None:
    dataset = swm.data.load_dataset(path, num_steps=2)
    train, val = torch.utils.data.random_split(dataset, [20, len(dataset) - 20])
    loader = torch.utils.data.DataLoader(train, batch_size=8, collate_fn=swm.data.collate)
    assert sum(len(batch["state"]) for batch in loader) == 20 and len(val) == len(dataset) - 20
    with pytest.raises(TypeError, match=r"swm\.data\.split"):
        swm.data.Loader(train)


def test_loader_gives_tensors_of_the_core(path: Path) -> None:
    loader = swm.data.Loader(path, batch_size=4, shuffle=False)
    for batch in loader:
        assert all(isinstance(value, torch.Tensor) for key, value in batch.items() if key != "env_name")
    arrays = next(iter(swm.data.Loader(path, batch_size=4, output="numpy")))
    assert isinstance(arrays["state"], np.ndarray)
    with pytest.raises(ValueError, match="unknown output"):
        swm.data.Loader(path, output="jax")  # type: ignore[arg-type]


@pytest.mark.parametrize("device", ["cpu", None])
def test_tables_of_torch(path: Path, device: Any) -> None:
    """``pin_memory`` reads into torch's own tensors; without a GPU they are ordinary ones."""
    plain = swm.data.Loader(path, batch_size=4, num_steps=2)
    pinned = swm.data.Loader(path, batch_size=4, num_steps=2, pin_memory=True, device=device)
    kept = [*pinned, *pinned]
    wanted = [{key: list(v) if isinstance(v, list) else v.clone() for key, v in batch.items()} for _ in range(2) for batch in plain]
    for batch, expected in zip(kept, wanted, strict=True):
        assert batch.keys() == expected.keys()
        for key, values in batch.items():
            assert values == expected[key] if isinstance(values, list) else torch.equal(values, expected[key])
    if torch.cuda.is_available():
        assert kept[0]["pixels"].is_pinned() or device is not None


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_batches_on_the_gpu(path: Path) -> None:
    plain = list(swm.data.Loader(path, batch_size=4, num_steps=2))
    for _ in range(20):
        moved = list(swm.data.Loader(path, batch_size=4, num_steps=2, device="cuda"))
        for batch, expected in zip(moved, plain, strict=True):
            assert batch["pixels"].is_cuda and torch.equal(batch["pixels"].cpu(), expected["pixels"])


def test_scalers_take_tensors(path: Path) -> None:
    dataset = swm.data.load_dataset(path, keys_to_load=["action", "state"])
    normalize = swm.data.column_normalizer(dataset, "state", "state")
    dataset.transform = normalize
    found = torch.cat([dataset[index]["state"] for index in range(len(dataset))])
    assert found.dtype == torch.float32
    torch.testing.assert_close(found.mean(dim=0), torch.zeros(3), atol=1e-5, rtol=0)
    for scaler in (swm.data.ZScoreScaler(), swm.data.PercentileScaler(0, 100)):
        values = torch.rand(50, 3, dtype=torch.float64)
        scaler.fit(values)
        torch.testing.assert_close(scaler.inverse_transform(scaler.transform(values)), values)
        np.testing.assert_allclose(scaler.transform(values.numpy()), scaler.transform(values).numpy())


def test_buffers_in_a_data_loader() -> None:
    buffer = swm.data.ReplayBuffer(100, history_len=3)
    buffer.write_episode({"action": torch.rand(10, 2), "state": [torch.rand(4) for _ in range(10)]})
    batch = next(iter(torch.utils.data.DataLoader(buffer, batch_size=4)))
    assert batch["action"].shape == (4, 3, 2) and batch["state"].shape == (4, 3, 4)


def test_goals_differ_between_workers_and_epochs(tmp_path: Path) -> None:
    """Each worker has a copy of the dataset and its generator, in every epoch: without more, all would repeat the same goals."""
    from torch.utils.data import DataLoader

    dataset = swm.data.load_dataset(write(tmp_path / "a.h5", text=False, lengths=(40,) * 4), num_steps=2)
    goals = swm.data.GoalDataset(dataset, (1.0, 0.0, 0.0, 0.0), goal_keys={"state": "goal_state"}, seed=1)

    def epochs() -> list[Any]:
        torch.manual_seed(0)
        loader = DataLoader(goals, batch_size=78, num_workers=2)
        return [torch.cat([batch["goal_state"][:, 0, 2] for batch in loader]) for _ in range(2)]

    first, second = epochs()
    assert not torch.equal(first, second) and not torch.equal(first[:78], first[78:])
    again = epochs()
    assert torch.equal(first, again[0]) and torch.equal(second, again[1])

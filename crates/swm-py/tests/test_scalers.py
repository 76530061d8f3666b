"""Scalers: statistics in float64, constants, and `transform` that `inverse_transform` undoes."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import stable_worldmodel_rs as swm

SCALERS = [swm.data.ZScoreScaler, swm.data.PercentileScaler]


def test_a_million_rows_of_float32_keep_their_mean_and_std() -> None:
    rows = (0.4249 + np.random.default_rng(0).normal(0, 1e-3, (1_000_000, 2))).astype(np.float32)
    scaler = swm.data.ZScoreScaler().fit(rows)
    assert scaler.mean is not None and scaler.std is not None
    np.testing.assert_allclose(scaler.mean, rows.mean(axis=0, dtype=np.float64, keepdims=True), rtol=1e-12)
    np.testing.assert_allclose(scaler.std, rows.std(axis=0, dtype=np.float64, keepdims=True), rtol=1e-9)


@pytest.mark.parametrize("kind", SCALERS)
@pytest.mark.parametrize("value", [0.1, 1234.567, -1e6, 0.0])
@pytest.mark.parametrize("noise", [0.0, 6e-8])
def test_constants_are_only_shifted(kind: Any, value: float, noise: float) -> None:
    """Constants, as float32 rounds them, and with the noise of its rounding."""
    rows = np.full((600, 2), value) * (1 + noise * np.random.default_rng(0).choice([-1, 1], (600, 2)))
    rows = rows.astype(np.float32)
    scaler = kind().fit(rows)
    assert np.abs(scaler.transform(rows)).max() <= abs(value) * 2e-7
    off = scaler.transform(rows + np.float32(1e-3))
    assert np.abs(off).max() < 0.2  # as float32 has it: near 1e6, a step is 0.06
    np.testing.assert_allclose(scaler.inverse_transform(scaler.transform(rows)), rows, rtol=2e-7)


@pytest.mark.parametrize("kind", SCALERS)
@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_transform_is_undone_in_the_type_of_the_values(kind: Any, dtype: Any) -> None:
    rows = (np.random.default_rng(0).uniform(-3, 5, (200, 3)) * [1, 1e-3, 0] + [0, 2, 0.5]).astype(dtype)
    scaler = kind(0, 100).fit(rows) if kind is swm.data.PercentileScaler else kind().fit(rows)
    scaled = scaler.transform(rows)
    back = scaler.inverse_transform(scaled)
    assert scaled.dtype == back.dtype == dtype
    np.testing.assert_allclose(back, rows, rtol=4 * np.finfo(dtype).eps, atol=4 * np.finfo(dtype).eps)
    assert np.array_equal(pickle.loads(pickle.dumps(scaler)).transform(rows), scaled)


def test_percentiles_are_those_of_numpy() -> None:
    rows = np.random.default_rng(0).normal(size=(1001, 2))
    scaler = swm.data.PercentileScaler(5, 95).fit(rows)
    assert scaler.q_low is not None and scaler.q_high is not None
    low, high = np.percentile(rows, [5, 95], axis=0)
    np.testing.assert_allclose([scaler.q_low, scaler.q_high], [low, high], rtol=1e-12)
    np.testing.assert_allclose(
        scaler.transform(rows), np.clip(2 * (rows - low) / (high - low) - 1, -1, 1), rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("kind", SCALERS)
def test_a_column_of_numbers_is_one_dimension(kind: Any) -> None:
    values = np.arange(50.0)
    scaler = kind().fit(values)
    assert scaler.transform(values).shape == (50,)
    assert scaler.transform(values).std() > 0.5


@pytest.mark.parametrize("kind", SCALERS)
def test_rows_without_a_number_do_not_count(kind: Any) -> None:
    rows = np.random.default_rng(0).normal(size=(40, 2))
    gaps = np.insert(rows, [3, 20], [[np.nan, 1.0], [np.inf, 2.0]], axis=0)
    assert np.array_equal(kind().fit(gaps).transform(rows), kind().fit(rows).transform(rows))
    with pytest.raises(ValueError, match="none of 2 rows counts"):
        kind().fit(np.full((2, 3), np.nan))
    with pytest.raises(ValueError, match="a single value has no statistics"):
        kind().fit(np.float32(1))
    with pytest.raises(ValueError, match="call fit"):
        kind().transform(rows)


def test_given_bounds_follow_the_same_rule() -> None:
    scaler = swm.data.ZScoreScaler(mean=[0.5, 2.0], std=[0.25, 1e-9])
    assert scaler.transform(np.array([[1.0, 2.5]])).tolist() == [[2.0, 0.5]]
    assert scaler.inverse_transform(np.array([[2.0, 0.5]])).tolist() == [[1.0, 2.5]]
    assert swm.data.ZScoreScaler(mean=[0.0], std=[1e-9], eps=0.0).transform(np.array([[1e-9]])).tolist() == [[1.0]]


def test_tensors_of_any_type() -> None:
    torch = pytest.importorskip("torch")
    rows = torch.rand(100, 2, generator=torch.Generator().manual_seed(0)) + 5
    for kind in SCALERS:
        scaler = kind().fit(rows.double())
        for dtype in (torch.bfloat16, torch.float16, torch.float32, torch.float64):
            scaled = scaler.transform(rows.to(dtype))
            assert scaled.dtype == dtype and kind().fit(rows.to(dtype)).transform(rows).dtype == torch.float32
        assert scaler.transform(torch.tensor([[5, 6]])).dtype == torch.float32
        leaf = rows.clone().requires_grad_()
        scaler.transform(leaf).sum().backward()
        assert leaf.grad is not None and leaf.grad.dtype == torch.float32

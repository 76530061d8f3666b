"""Scalers of columns, in the manner of scikit-learn. They take arrays and tensors, and can be pickled."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._tensors import to_numpy

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["ColumnNormalizer", "IdentityScaler", "PercentileScaler", "ZScoreScaler", "column_normalizer", "get_scaler"]


def _is_tensor(values: Any) -> bool:
    return hasattr(values, "detach")


def _like(values: Any, bound: NDArray[Any]) -> Any:
    """A bound as an array or, on the same device and of the same type, as a tensor."""
    return values.new_tensor(bound) if _is_tensor(values) else bound


def _rows(values: Any) -> NDArray[Any]:
    """``(N, D)``, without rows that hold a NaN, such as the missing action of an episode's last row."""
    array = to_numpy(values)
    array = array.reshape(-1, array.shape[-1])
    return array[~np.isnan(array).any(axis=1)]


def _optional(values: ArrayLike | None) -> NDArray[Any] | None:
    return None if values is None else np.asarray(values)


class IdentityScaler:
    """Leaves values as they are."""

    def fit(self, X: Any) -> Self:
        """Does nothing."""
        return self

    def transform(self, X: Any) -> Any:
        """The values."""
        return X

    def inverse_transform(self, X: Any) -> Any:
        """The values."""
        return X

    def fit_transform(self, X: Any) -> Any:
        """The values."""
        return self.fit(X).transform(X)

    def __call__(self, X: Any) -> Any:
        return X


class _FittedScaler(IdentityScaler):
    """What is fitted before it is used; called, it gives float32 tensors."""

    def _missing(self) -> ValueError:
        return ValueError(f"{type(self).__name__} has no bounds yet; call fit(data) first")

    def __call__(self, X: Any) -> Any:
        scaled = self.transform(X)
        return scaled.float() if _is_tensor(scaled) else scaled


class ZScoreScaler(_FittedScaler):
    """``(x - mean) / std`` per dimension; a standard deviation below ``eps`` counts as ``eps``.

    Example:
        >>> scaler = ZScoreScaler().fit(dataset.get_col_data("action"))
        >>> scaler.inverse_transform(scaler.transform(actions))
    """

    def __init__(self, mean: ArrayLike | None = None, std: ArrayLike | None = None, eps: float = 1e-8) -> None:
        self.mean: NDArray[Any] | None = _optional(mean)
        self.std: NDArray[Any] | None = _optional(std)
        self.eps: float = eps

    def fit(self, X: Any) -> Self:
        """Finds mean and standard deviation of ``(…, D)`` values; rows with a NaN do not count."""
        rows = _rows(X)
        self.mean, self.std = rows.mean(axis=0, keepdims=True), rows.std(axis=0, keepdims=True)
        return self

    def transform(self, X: Any) -> Any:
        """Standardizes."""
        if self.mean is None or self.std is None:
            raise self._missing()
        return (X - _like(X, self.mean)) / _like(X, np.maximum(self.std, self.eps))

    def inverse_transform(self, X: Any) -> Any:
        """The inverse of :meth:`transform`."""
        if self.mean is None or self.std is None:
            raise self._missing()
        return X * _like(X, self.std) + _like(X, self.mean)


class PercentileScaler(_FittedScaler):
    """Maps the percentiles ``low`` and ``high`` to -1 and 1, and cuts what lies beyond."""

    def __init__(
        self,
        low: float = 1.0,
        high: float = 99.0,
        q_low: ArrayLike | None = None,
        q_high: ArrayLike | None = None,
        eps: float = 1e-8,
    ) -> None:
        self.low: float = low
        self.high: float = high
        self.eps: float = eps
        self.q_low: NDArray[Any] | None = _optional(q_low)
        self.q_high: NDArray[Any] | None = _optional(q_high)

    def fit(self, X: Any) -> Self:
        """Finds the percentiles of ``(…, D)`` values; rows with a NaN do not count."""
        self.q_low, self.q_high = np.percentile(_rows(X), [self.low, self.high], axis=0)
        return self

    def transform(self, X: Any) -> Any:
        """Scales to -1…1."""
        if self.q_low is None or self.q_high is None:
            raise self._missing()
        width = np.maximum(self.q_high - self.q_low, self.eps)
        scaled = 2 * (X - _like(X, self.q_low)) / _like(X, width) - 1
        return scaled.clamp(-1, 1) if _is_tensor(scaled) else np.clip(scaled, -1, 1)

    def inverse_transform(self, X: Any) -> Any:
        """The inverse of :meth:`transform`, as far as nothing was cut."""
        if self.q_low is None or self.q_high is None:
            raise self._missing()
        return (X + 1) * _like(X, self.q_high - self.q_low) / 2 + _like(X, self.q_low)


_SCALERS: dict[str, type[Any]] = {"zscore": ZScoreScaler, "percentile": PercentileScaler, "none": IdentityScaler}


def get_scaler(method: str = "zscore", **kwargs: Any) -> Any:
    """A scaler that is not fitted: ``"zscore"``, ``"percentile"`` or ``"none"``."""
    if method not in _SCALERS:
        raise ValueError(f"Unknown normalizer method: {method!r}; use one of {list(_SCALERS)}")
    return _SCALERS[method](**kwargs)


class ColumnNormalizer:
    """A transform of items: ``item[target] = scaler(item[source])``.

    Attributes:
        lambd: The scaler, under the name that ``stable_pretraining``'s transforms use.
    """

    def __init__(self, scaler: Any, source: str, target: str) -> None:
        self.lambd = scaler
        self.source = source
        self.target = target

    def __call__(self, item: dict[str, Any]) -> dict[str, Any]:
        item[self.target] = self.lambd(item[self.source])
        return item

    def __repr__(self) -> str:
        return f"ColumnNormalizer({type(self.lambd).__name__}, {self.source!r} -> {self.target!r})"


def column_normalizer(dataset: Any, source: str, target: str, method: str = "zscore") -> ColumnNormalizer:
    """A transform that normalizes a column by the statistics of the whole dataset.

    Args:
        dataset: Has ``get_col_data``.
        source: The column.
        target: The name of the result.
        method: As :func:`get_scaler`; ``"none"`` reads nothing.
    """
    scaler = get_scaler(method)
    if method != "none":
        scaler.fit(np.asarray(dataset.get_col_data(source)))
    return ColumnNormalizer(scaler, source, target)

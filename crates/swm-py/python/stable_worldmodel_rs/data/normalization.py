"""Scalers of columns, in the manner of scikit-learn. They take arrays and tensors, and can be pickled."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._arguments import kind_of
from .._core import core as _swm
from ._tensors import to_numpy

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["ColumnNormalizer", "IdentityScaler", "PercentileScaler", "ZScoreScaler", "column_normalizer", "get_scaler"]


def _is_tensor(values: Any) -> bool:
    return hasattr(values, "detach")


def _wide(values: Any) -> Any:
    """Values in float64, in which scalers compute; in float32 on a device that has no float64."""
    if not _is_tensor(values):
        return np.asarray(values, np.float64)
    return values.float() if values.device.type == "mps" else values.double()


def _like(values: Any, bound: NDArray[Any]) -> Any:
    """A bound as an array or, on the same device and of the same type, as a tensor."""
    return values.new_tensor(bound) if _is_tensor(values) else bound


def _narrow(values: Any, like: Any) -> Any:
    """Values in the type of those that were given; of whole numbers, float64 (arrays) or float32 (tensors)."""
    if _is_tensor(like):
        return values.to(like.dtype) if like.is_floating_point() else values.float()
    kind = np.asarray(like).dtype
    return values.astype(kind) if kind.kind == "f" else values


def _statistics(values: Any, quantiles: list[float]) -> tuple[NDArray[Any], NDArray[Any], list[NDArray[Any]]]:
    """Means, stds and quantiles ``(D,)`` of ``(…, D)`` values, in float64; of ``(N,)`` values, ``(1,)``.

    Rows with a NaN or an infinity, such as the missing action of an episode's last row, do not count.
    """
    if values is None or hasattr(values, "get_col_data"):
        raise TypeError(f"a scaler is fitted on an array (N,) or (…, D), not on {values!r}; of a dataset, give a column: fit(dataset.get_col_data('action'))")
    array = to_numpy(values.detach().cpu().double() if _is_tensor(values) else values)
    if array.ndim == 0:
        raise ValueError("a single value has no statistics; give values of the shape (N,) or (…, D)")
    rows = array.reshape(-1, array.shape[-1]) if array.ndim > 1 else array[:, None]
    if rows.shape[1] == 0:
        raise ValueError(f"values of the shape {array.shape} have no elements")
    found = _swm.row_statistics(np.ascontiguousarray(rows, np.float64).reshape(-1), rows.shape[1], quantiles)
    if not found[0]:
        raise ValueError(f"none of {len(rows)} rows counts: each has a NaN or an infinity")
    mean, std, *rest = (np.asarray(each) for each in found)
    return mean, std, rest


def _divisors(center: NDArray[Any], scale: NDArray[Any], eps: float) -> NDArray[Any]:
    """The scale, and 1 where it is that of a constant: the core's rule for all statistics."""
    center, scale = np.broadcast_arrays(np.asarray(center, np.float64), np.asarray(scale, np.float64))
    return np.asarray(_swm.divisors(center.reshape(-1), scale.reshape(-1), eps)).reshape(scale.shape)


def _check_dim(scaler: Any, values: Any, center: Any) -> None:
    """Refuses values of another dim than a scaler was fitted on, but for those that a single number scales."""
    dim = center.shape[-1] if center.ndim else 1
    if dim > 1 and (values.ndim == 0 or values.shape[-1] != dim):
        raise ValueError(f"{kind_of(scaler)} was fitted on rows of {dim} values, and is given {list(values.shape)}; give (…, {dim})")


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
    """``(x - mean) / std`` per dimension, and back; a constant dimension is only shifted.

    A dimension is constant where its standard deviation is at most ``eps + 1e-6 * abs(mean)``. Results have the type of the
    values (float64 for whole numbers); means and standard deviations are computed in float64.

    Example:
        >>> scaler = ZScoreScaler().fit(dataset.get_col_data("action"))
        >>> scaler.inverse_transform(scaler.transform(actions))
    """

    def __init__(self, mean: ArrayLike | None = None, std: ArrayLike | None = None, eps: float = 1e-8) -> None:
        self.mean: NDArray[Any] | None = _optional(mean)
        self.std: NDArray[Any] | None = _optional(std)
        self.eps: float = eps

    def fit(self, X: Any) -> Self:
        """Finds mean and standard deviation of ``(…, D)`` or ``(N,)`` values; rows with a NaN or an infinity do not count."""
        mean, std, _ = _statistics(X, [])
        shape = (1, -1) if np.ndim(X) > 1 else (-1,)
        self.mean, self.std = mean.reshape(shape), std.reshape(shape)
        return self

    def _line(self, wide: Any) -> tuple[Any, Any]:
        """What is subtracted, and what is divided by then."""
        if self.mean is None or self.std is None:
            raise self._missing()
        return _like(wide, self.mean), _like(wide, _divisors(self.mean, self.std, self.eps))

    def transform(self, X: Any) -> Any:
        """Standardizes.

        Raises:
            ValueError: Values of another dim than those that it was fitted on.
        """
        wide = _wide(X)
        center, scale = self._line(wide)
        _check_dim(self, wide, center)
        return _narrow((wide - center) / scale, X)

    def inverse_transform(self, X: Any) -> Any:
        """The inverse of :meth:`transform`."""
        wide = _wide(X)
        center, scale = self._line(wide)
        _check_dim(self, wide, center)
        return _narrow(wide * scale + center, X)


class PercentileScaler(_FittedScaler):
    """Maps the percentiles ``low`` and ``high`` to -1 and 1, and cuts what lies beyond.

    A dimension is constant where half of the range between them is at most ``eps + 1e-6`` times their middle: its middle
    becomes 0, and it is not scaled. Results have the type of the values, as of :class:`ZScoreScaler`.
    """

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
        """Finds the percentiles of ``(…, D)`` or ``(N,)`` values; rows with a NaN or an infinity do not count."""
        _, _, (self.q_low, self.q_high) = _statistics(X, [self.low / 100, self.high / 100])
        return self

    def _line(self, wide: Any) -> tuple[Any, Any]:
        """The middle of the range, and half of its width."""
        if self.q_low is None or self.q_high is None:
            raise self._missing()
        center, half = (self.q_low + self.q_high) / 2, (self.q_high - self.q_low) / 2
        return _like(wide, center), _like(wide, _divisors(center, half, self.eps))

    def transform(self, X: Any) -> Any:
        """Scales to -1…1."""
        wide = _wide(X)
        center, half = self._line(wide)
        scaled = (wide - center) / half
        return _narrow(scaled.clamp(-1, 1) if _is_tensor(scaled) else np.clip(scaled, -1, 1), X)

    def inverse_transform(self, X: Any) -> Any:
        """The inverse of :meth:`transform`, as far as nothing was cut."""
        wide = _wide(X)
        center, half = self._line(wide)
        return _narrow(wide * half + center, X)


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

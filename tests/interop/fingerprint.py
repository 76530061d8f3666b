"""Digests of columns as `support.rs` of the integration tests makes them."""

import numpy as np

OFFSET, PRIME, MASK = 0xCBF29CE484222325, 0x100000001B3, (1 << 64) - 1


def fingerprint(array):
    """FNV-1a over the values' bits, in C order."""
    bits = {"f": {4: np.uint32, 8: np.uint64}}.get(array.dtype.kind, {}).get(array.dtype.itemsize)
    values = array.view(bits) if bits else array
    digest = OFFSET
    for value in values.ravel().tolist():
        digest = ((digest ^ (value & MASK)) * PRIME) & MASK
    return str(digest)

#!/usr/bin/env bash
# Software:  webdataset 1.0.2 with Pillow 13.0.0: images of uint16 in `TarWriter` and `decode`.
# Expected:  what `TarWriter` takes comes back, scaled to 8 bits at most, or fails.
# Happens:   `TarWriter` writes a PNG of 16 bits, which is right, and all image decoders ("rgb", "rgb8", "l", "l8", "pil", …) clip its
#            values at 255, without a warning: a depth in millimeters is 255 everywhere beyond 25 cm, or 1.0.
# Who:       users who keep depth images in shards.
# Seen:      [0, 100, 255, 256, 300, 600, 1200, 5000] is read as [0, 100, 255, 255, 255, 255, 255, 255]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages webdataset==1.0.2 pillow==13.0.0 numpy==2.4.6
"$python" -W ignore - "$folder/a.tar" <<'PYTHON'
import io
import sys

import numpy as np
import PIL
import webdataset
from PIL import Image

depth = np.array([[0, 100, 255, 256], [300, 600, 1200, 5000]], np.uint16)
with webdataset.TarWriter(sys.argv[1]) as writer:
    writer.write({"__key__": "a", "depth.png": depth, "depth.npy": depth})


def dataset():
    return webdataset.WebDataset(sys.argv[1], shardshuffle=False)


def decoded(how):
    image = np.asarray(next(iter(dataset().decode(how)))["depth.png"])
    return (image[..., 0] if image.ndim == 3 else image).ravel().tolist()


stored = np.asarray(Image.open(io.BytesIO(next(iter(dataset()))["depth.png"])))
as_npy = next(iter(dataset().decode()))["depth.npy"]
found = {how: decoded(how) for how in ("l8", "rgb8", "pil", "l", "rgb")}
print(f"webdataset {webdataset.__version__}, Pillow {PIL.__version__}: stored {stored.ravel().tolist()}, .npy {as_npy.ravel().tolist()}")
for how, values in found.items():
    print(f'decode("{how}"): {np.round(values, 2).tolist()}')
clipped = np.minimum(depth, 255).ravel()
assert np.array_equal(stored, depth) and np.array_equal(as_npy, depth)
assert all(values == clipped.tolist() for how, values in found.items() if how in ("l8", "rgb8", "pil"))
assert all(np.allclose(found[how], clipped / 255) for how in ("l", "rgb"))
PYTHON

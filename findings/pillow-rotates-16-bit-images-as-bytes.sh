#!/usr/bin/env bash
# Software:  Pillow 13.0.0: `rotate` and `transform` with BILINEAR or BICUBIC, `paste` and `convert` of images of 16 bits (mode I;16).
# Expected:  values that were interpolated between those of the image, as `resize` gives them; or an error, as `filter` gives.
# Happens:   both take the bytes for pixels: each value of the result is below 256. `paste` of a number writes its low byte twice, and
#            `convert("I;16")` of floats clips at 255. (Its manual calls support for this mode limited; it names none of these.)
# Who:       users who augment or draw into depth images, which 16-bit PNG files are opened as: depth in millimeters becomes noise.
# Seen:      1000 throughout, turned by 10 degrees: the center has values from 3 to 231 (1000 is 3 * 256 + 232), and is 1000 by NEAREST
#            and in modes I and F; `paste(5000, box)` writes 34952; 1000.0 converts to 255
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages pillow==13.0.0 numpy==2.4.6
"$python" - "$folder/depth.png" <<'PYTHON'
import sys

import numpy as np
import PIL
from PIL import Image

FILTERS = [Image.Resampling.NEAREST, Image.Resampling.BILINEAR, Image.Resampling.BICUBIC]
Image.fromarray(np.full((64, 64), 1000, np.uint16)).save(sys.argv[1])
depth = Image.open(sys.argv[1])


def center(image):
    """Least and greatest value."""
    values = np.asarray(image)[24:40, 24:40]
    return int(values.min()), int(values.max())


def turned(image):
    return {sample.name: center(image.rotate(10, sample)) for sample in FILTERS}


def moved(image):
    return {sample.name: center(image.transform((64, 64), Image.Transform.AFFINE, (1, 0, 2, 0, 1, 3), sample)) for sample in FILTERS}


seen = {"rotate": turned(depth), "transform": moved(depth)}
others = {mode: {*turned(depth.convert(mode)).values(), *moved(depth.convert(mode)).values()} for mode in ("I", "F")}
resized = {center(depth.resize((96, 96), sample)) for sample in FILTERS}
back = center(depth.convert("I").rotate(10, Image.Resampling.BILINEAR).convert("I;16"))
clipped = center(depth.convert("F").convert("I;16"))
pasted = depth.copy()
pasted.paste(5000, (24, 24, 40, 40))
drawn = Image.new("I;16", (64, 64), 5000)
print(f"Pillow {PIL.__version__}, mode {depth.mode}, least and greatest value of the center: {seen}")
print(f"other modes: {others}; resize {resized}; by way of mode I {back}")
print(f"paste of 5000: {center(pasted)}, Image.new with 5000: {center(drawn)}; from mode F {clipped}")
for values in seen.values():
    assert values["NEAREST"] == (1000, 1000) and all(values[name][1] < 256 for name in ("BILINEAR", "BICUBIC"))
assert resized == others["I"] == others["F"] == {(1000, 1000)} and back == (1000, 1000)
assert 5000 % 256 == 0x88 and center(pasted) == (0x8888, 0x8888) and center(drawn) == (5000, 5000) and clipped == (255, 255)
PYTHON

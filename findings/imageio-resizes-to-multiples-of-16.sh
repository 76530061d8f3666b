#!/usr/bin/env bash
# Software:  imageio 2.38.1 with imageio-ffmpeg 0.8.1: an MP4 of images of 100 × 100.
# Expected:  a video of 100 × 100, which H.264 allows.
# Happens:   the images are enlarged to 112 × 112 (multiples of 16), with a line in the log: positions in pixels no longer fit
#            those in the other columns. `macro_block_size=2` keeps even sides.
# Who:       users who bring videos that were written so (by most scripts of the field) together with states in pixels.
# Seen:      (10, 112, 112, 3)
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages imageio==2.38.1 imageio-ffmpeg==0.8.1 numpy==2.4.6
"$python" - "$folder/a.mp4" 2>/dev/null <<'PYTHON'
import sys
from importlib.metadata import version

import imageio.v3 as iio
import numpy as np

iio.imwrite(sys.argv[1], np.zeros((10, 100, 100, 3), np.uint8), fps=10)
plain = iio.imread(sys.argv[1]).shape
iio.imwrite(sys.argv[1], np.zeros((10, 100, 100, 3), np.uint8), fps=10, macro_block_size=2)
print(f"imageio {version('imageio')}: {plain}; with macro_block_size=2: {iio.imread(sys.argv[1]).shape}")
assert plain == (10, 112, 112, 3)
PYTHON

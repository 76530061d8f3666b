#!/usr/bin/env bash
# Software:  imageio 2.38.1 with Pillow: a GIF with equal frames in a row.
# Expected:  as many frames as were written.
# Happens:   equal frames in a row become one with a longer duration: frame i of the file is not step i.
# Who:       users who keep episodes as GIF, where an agent often does not move, and read them back by number.
# Seen:      6 frames written, 3 read
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages imageio==2.38.1 pillow==12.3.0 numpy==2.4.6
"$python" - "$folder/a.gif" <<'PYTHON'
import sys

import imageio.v3 as iio
import numpy as np
from importlib.metadata import version

frames = np.stack([np.full((8, 8, 3), level, np.uint8) for level in (0, 0, 90, 90, 90, 200)])
iio.imwrite(sys.argv[1], frames, duration=100)
found = iio.imread(sys.argv[1])
print(f"imageio {version('imageio')}, Pillow {version('pillow')}: {len(frames)} frames written, {len(found)} read")
assert len(found) == 3
PYTHON

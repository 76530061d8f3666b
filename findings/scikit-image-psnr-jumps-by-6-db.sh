#!/usr/bin/env bash
# Software:  scikit-image 0.26.0: `metrics.peak_signal_noise_ratio` of floats without `data_range`.
# Expected:  the range is that of the data type, as its manual says: frames of one video are measured by one scale.
# Happens:   it is 2 where the true image has a value below 0, and 1 where it has none: the same error counts 6.02 dB more or less by what
#            the image shows. `structural_similarity` asks for `data_range` instead.
# Who:       users who compare predictions of world models frame by frame: on images from -1 to 1, bright frames and those that fade to white
#            count 6 dB less; on images from 0 to 1, one value of -1e-6 makes a frame better by 6 dB.
# Seen:      error of 0.1 everywhere: 20.00 dB for a frame within 0 to 1, 26.02 dB for the same frame with one value of -1e-6; within -1 to 1,
#            26.02 dB, and 20.00 dB for a frame without a dark pixel. With `data_range` given, both are equal
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages scikit-image==0.26.0 numpy==2.4.6
"$python" - <<'PYTHON'
import numpy as np
import skimage
from skimage.metrics import peak_signal_noise_ratio

rng = np.random.default_rng(0)
frame = rng.uniform(0, 0.9, (64, 64, 3)).astype(np.float32)
below = frame.copy()
below[0, 0, 0] = -1e-6
dark, bright = frame * 2 - 1, frame


def decibels(true, **options):
    return round(float(peak_signal_noise_ratio(true, true + np.float32(0.1), **options)), 2)


unit = [decibels(frame), decibels(below)]
signed = [decibels(dark), decibels(bright)]
given = [decibels(frame, data_range=1), decibels(below, data_range=1), decibels(dark, data_range=2), decibels(bright, data_range=2)]
print(f"scikit-image {skimage.__version__}, dB of an error of 0.1: 0 to 1: {unit[0]}, with one value of -1e-6: {unit[1]}")
print(f"-1 to 1: {signed[0]}, without a dark pixel: {signed[1]}; with data_range given: {given}")
assert unit == [20.0, 26.02] and signed == [26.02, 20.0] and given == [20.0, 20.0, 26.02, 26.02]
PYTHON

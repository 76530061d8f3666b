#!/usr/bin/env bash
# Software:  opencv-python-headless 5.0.0.93: `VideoCapture.set(CAP_PROP_POS_FRAMES, i)`; imageio 2.38.1 with av 19.0.2:
#            `imread(path, index=i, plugin="pyav")`.
# Expected:  the frame that has this index, as reading from the beginning counts them.
# Happens:   both compute the index from a time and one rate for the whole file: where the camera left out frames or changed its rate, others
#            come, by OpenCV also before that place (imageio's `constant_framerate=None` takes each MP4 for constant).
#            `get(CAP_PROP_POS_FRAMES)` goes on from the index that was asked for.
# Who:       users who read frames at random from videos of cameras, and pair them with rows by index.
# Seen:      300 frames at 30 fps, 3 missing after frame 99: for 150 and 200 OpenCV gives 148 and 199, imageio 147 and 197. 100 frames at
#            30 fps and 200 at 10 fps: for 50, 150 and 250 OpenCV gives 78, 192 and 277, imageio 50, 150 and 150. In order all are right
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages opencv-python-headless==5.0.0.93 imageio==2.38.1 av==19.0.2 numpy==2.4.6
"$python" - "$folder/video.mp4" <<'PYTHON'
import sys
from fractions import Fraction
from importlib.metadata import version

import av
import cv2
import imageio.v3
import numpy as np

CLOCK = 90_000


def write(times):
    """Frames that begin at these times, in seconds. Two halves of gray have the number of the frame in base 20."""
    with av.open(sys.argv[1], "w") as file:
        stream = file.add_stream("libx264", rate=30, options={"crf": "5", "g": "50", "sc_threshold": "0"})
        stream.width = stream.height = 32
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, CLOCK)
        for number, time in enumerate(times):
            image = np.full((32, 32, 3), 10 + number // 20 * 12, np.uint8)
            image[:, 16:] = 10 + number % 20 * 12
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = round(time * CLOCK), Fraction(1, CLOCK)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())


def number(image):
    tens, ones = (round((np.asarray(image)[8:24, side].mean() - 10) / 12) for side in (slice(4, 12), slice(20, 28)))
    return int(tens * 20 + ones)


def read():
    video, found = cv2.VideoCapture(sys.argv[1]), []
    while (image := video.read()[1]) is not None:
        found.append(number(image))
    return found


def sought(indices):
    video, found = cv2.VideoCapture(sys.argv[1]), {}
    for index in indices:
        video.set(cv2.CAP_PROP_POS_FRAMES, index)
        found[index] = number(video.read()[1])
        assert video.get(cv2.CAP_PROP_POS_FRAMES) == index + 1
    return found


def by_imageio(indices, **options):
    return {index: number(imageio.v3.imread(sys.argv[1], index=index, plugin="pyav", **options)) for index in indices}


GAP, SLOWER = [50, 99, 150, 200, 299], [50, 150, 250]
write(np.arange(300) / 30)
even = read() == list(range(300)) and sought(GAP) == by_imageio(GAP) == {index: index for index in GAP}
write(np.r_[0:100, 103:303] / 30)
gap = read() == list(range(300)), sought(GAP), by_imageio(GAP), by_imageio(GAP, constant_framerate=False)
write(np.r_[np.arange(100) / 30, 100 / 30 + np.arange(200) / 10])
slower = read() == list(range(300)), sought(SLOWER), by_imageio(SLOWER)
print(f"OpenCV {cv2.__version__}, imageio {version('imageio')}, even rate: all right is {even}")
print(f"3 frames missing, in order is {gap[0]}; by index, OpenCV: {gap[1]}, imageio: {gap[2]}, not taken for constant: {gap[3]}")
print(f"30 fps, then 10, in order is {slower[0]}; by index, OpenCV: {slower[1]}, imageio: {slower[2]}")
assert even and gap[0] and slower[0] and gap[3] == {index: index for index in GAP}
assert gap[1] == {50: 50, 99: 99, 150: 148, 200: 199, 299: 299} and gap[2] == {50: 50, 99: 99, 150: 147, 200: 197, 299: 296}
assert slower[1] == {50: 78, 150: 192, 250: 277} and slower[2] == {50: 50, 150: 150, 250: 150}
PYTHON

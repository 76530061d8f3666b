#!/usr/bin/env bash
# Software:  imageio 2.38.1 with imageio-ffmpeg 0.8.1: the plugin FFMPEG, which `imageio.v2.get_reader` and `mimread` take for videos, and
#            `imageio.v3` where PyAV is not installed.
# Expected:  each frame of the file once, as `count_frames` counts them, and as PyAV and OpenCV read them.
# Happens:   frames come at one rate: where a frame lasts longer, it comes several times, so that all later ones have another index.
#            `get_data(i)` counts such images, and finds another one where it seeks (more than 100 ahead, or back) than where it reads.
# Who:       users who bring videos of cameras that leave out frames, or change their rate, together with rows by counting.
# Seen:      300 frames at 30 fps, 3 missing after frame 99: 303 images, `count_frames` 300; get_data(200) is frame 197 by reading, and 200
#            by seeking. 25 frames at 10 fps and 25 at 30 fps: 100 images. PyAV gives 300 and 50
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages imageio==2.38.1 imageio-ffmpeg==0.8.1 av==19.0.2 numpy==2.4.6
"$python" - "$folder/video.mp4" <<'PYTHON'
import sys
from fractions import Fraction
from importlib.metadata import version

import av
import imageio.v2
import imageio.v3
import numpy as np

CLOCK = 90_000


def write(times):
    """Frames that begin at these times, in seconds. Two halves of gray have the number of the frame in base 20."""
    with av.open(sys.argv[1], "w") as file:
        stream = file.add_stream("libx264", rate=30, options={"crf": "5", "bf": "0"})
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


def numbers(plugin):
    return [number(image) for image in imageio.v3.imiter(sys.argv[1], plugin=plugin)]


write(np.r_[0:100, 103:303] / 30)
gap, whole = numbers("FFMPEG"), numbers("pyav")
reader = imageio.v2.get_reader(sys.argv[1])
by_reading = [number(reader.get_data(index)) for index in range(201)][-1]
counted = reader.count_frames()
reader = imageio.v2.get_reader(sys.argv[1])
by_seeking = number(reader.get_data(200))
write(np.r_[np.arange(25) / 10, 2.5 + np.arange(25) / 30])
faster = len(numbers("FFMPEG")), len(numbers("pyav"))
versions = " with ".join(f"{name} {version(name)}" for name in ("imageio", "imageio-ffmpeg"))
print(f"{versions}: {len(gap)} images, count_frames {counted}, PyAV {len(whole)}")
print(f"images 98 to 105 are frames {gap[98:106]}; get_data(200) is {by_reading} by reading, {by_seeking} by seeking")
print(f"10 fps, then 30: {faster[0]} images, PyAV {faster[1]}")
assert whole == list(range(300)) and gap == [*range(100), 99, 99, 99, *range(100, 300)] and counted == 300
assert by_reading == 197 and by_seeking == 200 and faster == (100, 50)
PYTHON

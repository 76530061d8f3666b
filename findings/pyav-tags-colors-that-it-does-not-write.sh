#!/usr/bin/env bash
# Software:  av 19.0.2 (PyAV) and OpenCV 5.0.0: a video of RGB images whose stream is given the color space BT.709.
# Expected:  images are converted to that space, or the file is not labeled so.
# Happens:   `stream.encode` converts RGB by BT.601 all the same, and the file says BT.709: readers that follow the label show other
#            colors. `frame.reformat(format="yuv420p", dst_colorspace="ITU709")` before it gives the right ones.
# Who:       users who write episodes by PyAV and set the color space as players want it: a policy sees other colors in the recording
#            than in the environment.
# Seen:      the color (200, 50, 50) is read as (199, 48, 49) without a label and (212, 62, 47) with it, by both readers
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages av==19.0.2 opencv-python-headless==5.0.0.93 numpy==2.4.6
"$python" - "$folder/a.mp4" <<'PYTHON'
import sys

import av
import cv2
import numpy as np

path, color, bt709 = sys.argv[1], (200, 50, 50), 1


def written(labeled, converted):
    with av.open(path, "w") as file:
        stream = file.add_stream("libx264", rate=10, options={"crf": "0"})
        stream.width = stream.height = 64
        stream.pix_fmt = "yuv420p"
        if labeled:
            context = stream.codec_context
            context.colorspace = context.color_primaries = context.color_trc = bt709
        for _ in range(5):
            frame = av.VideoFrame.from_ndarray(np.full((64, 64, 3), color, np.uint8), format="rgb24")
            if converted:
                frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709")
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    with av.open(path) as file:
        frame = next(file.decode(video=0))
        label, by_av = int(frame.colorspace), frame.to_ndarray(format="rgb24")[32, 32].astype(int)
    by_cv = cv2.VideoCapture(path).read()[1][32, 32, ::-1].astype(int)
    return label, by_av, by_cv


plain, labeled, right = written(False, False), written(True, False), written(True, True)
print(f"PyAV {av.__version__}, OpenCV {cv2.__version__}: the color {color} is read by the two as")
for name, (label, by_av, by_cv) in {"no label": plain, "label": labeled, "label, reformat": right}.items():
    print(f"{name}: color space {label}, {by_av}, {by_cv}")


def error(written):
    return max(int(np.abs(one - color).max()) for one in written[1:])


assert labeled[0] == right[0] == bt709 != plain[0]
assert error(plain) <= 3 and error(right) <= 3 and error(labeled) >= 10
PYTHON

#!/usr/bin/env bash
# Software:  av 15.1.0 and 16.1.0 beside 17.1.0 and 19.0.2 (PyAV); lerobot 0.6.1 requires av below 16.
# Expected:  a frame becomes RGB by the color space that its file names, and its attribute `colorspace` has.
# Happens:   up to version 16 every frame becomes RGB by BT.601, whatever it is labeled, and the given `src_colorspace` changes nothing.
# Who:       users of LeRobot whose videos are labeled BT.709, as most cameras and encoders label them, where torchcodec cannot be loaded and
#            LeRobot reads by PyAV: colors are others than those that torchcodec shows, and than those of the camera at evaluation.
# Seen:      (200, 50, 50) in BT.709 is read as (186, 32, 50) by 15.1.0 and 16.1.0, and as (199, 48, 49) by 17.1.0 and 19.0.2
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
cat >"$folder/write.py" <<'PYTHON'
import sys

import av
import numpy as np

with av.open(sys.argv[1], "w") as file:
    stream = file.add_stream("libx264", rate=10, options={"crf": "0"})
    stream.width = stream.height = 64
    stream.pix_fmt = "yuv420p"
    context = stream.codec_context
    context.colorspace = context.color_primaries = context.color_trc = 1
    for _ in range(3):
        frame = av.VideoFrame.from_ndarray(np.full((64, 64, 3), (200, 50, 50), np.uint8), format="rgb24")
        file.mux(stream.encode(frame.reformat(format="yuv420p", dst_colorspace="ITU709")))
    file.mux(stream.encode())
PYTHON
cat >"$folder/read.py" <<'PYTHON'
import sys

import av

with av.open(sys.argv[1]) as file:
    frame = next(file.decode(video=0))
    plain = frame.to_ndarray(format="rgb24")[32, 32].tolist()
    given = frame.reformat(format="rgb24", src_colorspace="ITU709").to_ndarray()[32, 32].tolist()
print(f"PyAV {av.__version__}: color space {int(frame.colorspace)}, {plain}; with src_colorspace {given}")
error = max(abs(one - other) for one, other in zip(plain, (200, 50, 50)))
assert int(frame.colorspace) == 1 and (error >= 10) == (sys.argv[2] == "wrong") and (error <= 3) == (sys.argv[2] == "right")
PYTHON
packages av==19.0.2 numpy==2.4.6
"$python" "$folder/write.py" "$folder/a.mp4"
"$python" "$folder/read.py" "$folder/a.mp4" right
for version in 15.1.0:wrong 16.1.0:wrong 17.1.0:right; do
    packages "av==${version%:*}" numpy==2.4.6
    "$python" "$folder/read.py" "$folder/a.mp4" "${version#*:}"
done

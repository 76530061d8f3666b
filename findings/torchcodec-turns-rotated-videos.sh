#!/usr/bin/env bash
# Software:  torchcodec 0.17.0 and PyAV 19.0.2 (Python 3.12 or later) on a video with a rotation of 90 degrees in its header.
# Expected:  both give the same frames.
# Happens:   torchcodec turns them, PyAV gives them as they are stored: height and width are exchanged.
# Who:       users with videos of phones, who train by one library and evaluate by another; LeRobot reads by both.
# Seen:      torchcodec 64 × 48, PyAV 48 × 64 (height × width)
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
ffmpeg -v error -f lavfi -i testsrc2=size=64x48:rate=10:duration=2 -c:v libx264 "$folder/plain.mp4"
ffmpeg -v error -i "$folder/plain.mp4" -c copy -metadata:s:v rotate=90 "$folder/turned.mp4"
if [[ $(ffprobe -v error -show_entries stream_side_data=rotation -of default=nk=1:nw=1 "$folder/turned.mp4") == "" ]]; then
    # FFmpeg 6 and later have an option in place of the tag.
    ffmpeg -v error -y -display_rotation 90 -i "$folder/plain.mp4" -c copy "$folder/turned.mp4"
fi
packages torchcodec==0.17.0 torch==2.15.0 numpy==2.4.6
"$python" - "$folder/turned.mp4" <<'PYTHON'
import sys
from importlib.metadata import version

from torchcodec.decoders import VideoDecoder

shape = tuple(VideoDecoder(sys.argv[1])[0].shape)
print(f"torchcodec {version('torchcodec')}: {shape}")
assert shape == (3, 64, 48)
PYTHON
packages av==19.0.2
"$python" - "$folder/turned.mp4" <<'PYTHON'
import sys

import av

with av.open(sys.argv[1]) as container:
    frame = next(container.decode(video=0))
print(f"PyAV {av.__version__}: {(frame.height, frame.width, 3)}, rotation {frame.rotation}")
assert (frame.height, frame.width) == (48, 64)
PYTHON

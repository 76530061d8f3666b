#!/usr/bin/env bash
# Software:  PyAV 19.0.2 (Python 3.12 or later) on an MP4 that was cut without encoding it anew (`ffmpeg -ss … -c copy`).
# Expected:  `stream.frames` is how many frames are decoded.
# Happens:   it counts frames that the edit list hides, from the key frame to the cut.
# Who:       users who bring videos and rows of a lab together by counting.
# Seen:      frames 30, decoded 27
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages av==19.0.2
ffmpeg -v error -f lavfi -i testsrc2=size=64x64:rate=10:duration=4 -c:v libx264 -g 10 -bf 0 "$folder/whole.mp4"
ffmpeg -v error -ss 1.3 -i "$folder/whole.mp4" -c copy "$folder/cut.mp4"
"$python" - "$folder/cut.mp4" <<'PYTHON'
import sys

import av

with av.open(sys.argv[1]) as container:
    count, decoded = container.streams.video[0].frames, sum(1 for _ in container.decode(video=0))
print(f"PyAV {av.__version__}: frames {count}, decoded {decoded}")
assert (count, decoded) == (30, 27)
PYTHON

#!/usr/bin/env bash
# Software:  PyAV 19.0.2 (Python 3.12 or later) on H.264 with open GOPs, x264's `open-gop=1`.
# Expected:  `seek(time, backward=True)` ends at a frame at or before that time.
# Happens:   for the last one or two frames before a key frame it ends at the key frame, one or two images late.
# Who:       users who read single frames of videos at random, as loaders of clips do.
# Seen:      at 10 frames per second, sought and found: 0.9 and 1.0 s, 2.8 and 3.0 s, 2.9 and 3.0 s
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
made_by 3.12 3.13
packages av==19.0.2
ffmpeg -v error -f lavfi -i testsrc2=size=64x64:rate=10:duration=4 -c:v libx264 \
    -x264-params open-gop=1:keyint=10:bframes=3:scenecut=0 "$folder/open.mp4"
"$python" - "$folder/open.mp4" <<'PYTHON'
import sys

import av

late = []
with av.open(sys.argv[1]) as container:
    stream = container.streams.video[0]
    for time in [float(frame.time) for frame in container.decode(stream)]:
        container.seek(round(time / stream.time_base), stream=stream, backward=True)
        first = float(next(container.decode(stream)).time)
        if first > time:
            late.append((time, first))
print(f"PyAV {av.__version__}: sought and found, in s: {late}")
assert late == [(0.9, 1.0), (2.8, 3.0), (2.9, 3.0)]
PYTHON

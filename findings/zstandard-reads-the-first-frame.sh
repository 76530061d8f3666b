#!/usr/bin/env bash
# Software:  zstandard 0.25.0: `decompress`, `ZstdDecompressor.decompress`, `read_to_iter` and `decompressobj`.
# Expected:  a file that was written in several sessions is read to its end, as by gzip, bz2, lzma and the program `zstd`.
# Happens:   these return the first frame only, and pass over what follows, without an error; `open`, `stream_reader` and `copy_stream`
#            read all frames. (Its manual says so of `decompress`.)
# Who:       users who append metrics or episodes to a compressed file, or join such files by `cat`: all but the first part is missing.
# Seen:      100 lines of each of 3 sessions: 100 by decompress, read_to_iter and decompressobj; 300 by open and by gzip.decompress
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages zstandard==0.25.0
"$python" - "$folder/metrics.jsonl.zst" <<'PYTHON'
import bz2
import gzip
import io
import lzma
import sys

import zstandard

SESSIONS = [b'{"step": %d}\n' % session * 100 for session in range(3)]


def joined(compress):
    return b"".join(map(compress, SESSIONS))


for session in SESSIONS:
    with open(sys.argv[1], "ab") as file:
        file.write(zstandard.compress(session))
data = open(sys.argv[1], "rb").read()
reader = zstandard.ZstdDecompressor()
first = {
    "decompress": zstandard.decompress(data),
    "ZstdDecompressor.decompress": reader.decompress(data),
    "read_to_iter": b"".join(reader.read_to_iter(data)),
    "decompressobj": reader.decompressobj().decompress(data),
}
copy = io.BytesIO()
reader.copy_stream(io.BytesIO(data), copy)
whole = {
    "open": zstandard.open(sys.argv[1], "rb").read(),
    "stream_reader": reader.stream_reader(io.BytesIO(data)).read(),
    "copy_stream": copy.getvalue(),
    "decompressobj(read_across_frames=True)": reader.decompressobj(read_across_frames=True).decompress(data),
    "gzip": gzip.decompress(joined(gzip.compress)),
    "bz2": bz2.decompress(joined(bz2.compress)),
    "lzma": lzma.decompress(joined(lzma.compress)),
}
lines = [{name: text.count(b"\n") for name, text in texts.items()} for texts in (first, whole)]
print(f"zstandard {zstandard.__version__}, lines of 300 that are read: {lines[0]}")
print(lines[1])
assert set(lines[0].values()) == {100} and set(lines[1].values()) == {300}
PYTHON

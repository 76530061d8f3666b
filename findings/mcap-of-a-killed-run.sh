#!/usr/bin/env bash
# Software:  mcap 1.6.0 (Python) on a file whose writer was killed, so that it has no summary.
# Expected:  the messages of all whole chunks, or an error that names what is missing.
# Happens:   `make_reader(…).iter_messages()` takes what lies at the end for a footer: no message and an error of a length that
#            misleads. `NonSeekingReader(…).iter_messages(log_time_order=False)` gives all messages of whole chunks.
# Who:       users who look into a recording here that was killed, before `swm verify --fix`.
# Seen:      make_reader: 0 messages, then an error; NonSeekingReader: all messages of whole chunks
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
packages mcap==1.6.0
"$python" - "$folder/a.mcap" <<'PYTHON'
import sys
from importlib.metadata import version

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import Writer

with open(sys.argv[1], "wb") as file:
    writer = Writer(file, chunk_size=1000)
    writer.start()
    channel = writer.register_channel(topic="state", message_encoding="json", schema_id=0)
    for step in range(200):
        writer.add_message(channel, log_time=step, data=b"[0.0, 1.0, 2.0]", publish_time=step)
    file.flush()  # Killed here: `finish` is never called.


def count(messages):
    found = 0
    try:
        for _ in messages:
            found += 1
    except (McapError, Exception) as error:
        return found, f"{type(error).__name__}: {error}"[:90]
    return found, "no error"


with open(sys.argv[1], "rb") as file:
    seeking = count(make_reader(file).iter_messages())
with open(sys.argv[1], "rb") as file:
    reading = count(NonSeekingReader(file).iter_messages(log_time_order=False))
print(f"mcap {version('mcap')}: make_reader {seeking}, NonSeekingReader {reading}")
assert seeking[0] == 0 and seeking[1] != "no error" and reading[0] > 100
PYTHON

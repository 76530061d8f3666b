#!/usr/bin/env bash
# Software:  pylance 4.0.0, 8.0.0 and 14.0.0.
# Expected:  tables that one release writes are read by programs built for the one before.
# Happens:   the file version that is written unasked goes up: 2.0, 2.1, 2.2. Older readers refuse newer files.
# Who:       users of Lance tables here and in the reference; `data_storage_version=` of `write_dataset` fixes it.
# Seen:      4.0.0: 2.0; 8.0.0: 2.1; 14.0.0: 2.2
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/python.sh"
for pair in 4.0.0=2.0 8.0.0=2.1 14.0.0=2.2; do
    packages "pylance==${pair%=*}"
    "$python" - "$folder/${pair%=*}.lance" "${pair#*=}" <<'PYTHON'
import sys

import lance
import pyarrow

written = lance.write_dataset(pyarrow.table({"x": [1, 2]}), sys.argv[1]).data_storage_version
print(f"pylance {lance.__version__}: file version {written}")
assert written == sys.argv[2]
PYTHON
done

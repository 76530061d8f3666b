"""``python -m stable_worldmodel_rs``: the script ``swm-rs``."""

import sys

from ._cli import main

sys.exit(main())

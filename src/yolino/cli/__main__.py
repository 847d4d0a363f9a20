"""`python -m yolino.cli`: the same as `yolino`."""

from __future__ import annotations

import sys

from yolino.cli import main

sys.exit(main())

"""`make bench`. The tests also use the rig and the runner, under the names that pytest gives them."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from cobot.__main__ import BLAS_THREADS

os.environ.setdefault(BLAS_THREADS, "1")  # what runs in this process shall run as in one of `cobot`'s
sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))

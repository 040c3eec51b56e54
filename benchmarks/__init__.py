"""`make bench`; the rig and the runner of the tests serve it too, by the names that pytest gives them."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tests"))

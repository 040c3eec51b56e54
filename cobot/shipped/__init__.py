"""Files that users read and that are part of cobot: the settings and robots in `config/`, and `sequences/`.

In a clone, these are folders at its top, and this folder contains links to them. In an installed cobot, this
folder contains the files.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent
NAMES = ("config", "sequences")

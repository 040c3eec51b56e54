"""Files that users read, and that ship with cobot: the settings and robots of `config/`, and `sequences/`.

In a clone they are folders at its top, and this folder has links to them. An installed cobot has the files
here.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent
NAMES = ("config", "sequences")

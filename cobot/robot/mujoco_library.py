"""Makes the C interface of MuJoCo available to compiled modules.

They are not linked against the library: its place is only known when they are imported, and differs between
a checkout and an installation. The package whose compiled modules call MuJoCo imports this one in its
`__init__`, because Python resolves all symbols of a module when it opens the file.
"""

from __future__ import annotations

import ctypes
import logging
from pathlib import Path

import mujoco

log = logging.getLogger("cobot.mujoco")


def _library() -> Path:
    """The file that `import mujoco` has loaded: another copy would have models of its own."""
    folder = Path(mujoco.__file__).parent
    found = sorted([*folder.glob("libmujoco.so*"), *folder.glob("libmujoco*.dylib")])
    if not found:
        raise ImportError(f"mujoco-core brings no library: there is no libmujoco in {folder}")
    return found[0]


# It is loaded already, for its own bindings alone. Opened again it stays the same one, and its symbols
# become visible to all.
LIBRARY = ctypes.CDLL(str(_library()), mode=ctypes.RTLD_GLOBAL)

# Without a handler MuJoCo appends its warnings to a file in the folder where the user happens to be.
mujoco.set_mju_user_warning(lambda text: log.warning("MuJoCo: %s", text))

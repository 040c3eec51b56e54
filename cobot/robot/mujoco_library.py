"""Makes the C interface of MuJoCo available to compiled modules.

The compiled modules are not linked against the library, because its path is known only at import and differs
between a checkout and an installation. A package whose compiled modules call MuJoCo imports this module in
its `__init__`, because Python resolves all symbols of a module when it opens the file.
"""

from __future__ import annotations

import ctypes
import logging
from pathlib import Path

import mujoco

log = logging.getLogger("cobot.mujoco")


def _library() -> Path:
    """The library file that `import mujoco` has loaded. A second copy of the library could not share models
    with the first.
    """
    folder = Path(mujoco.__file__).parent
    found = sorted([*folder.glob("libmujoco.so*"), *folder.glob("libmujoco*.dylib")])
    if not found:
        raise ImportError(f"mujoco-core contains no library: there is no libmujoco in {folder}")
    return found[0]


# The library is already loaded, but only its own bindings can see its symbols. Opening it again makes the
# symbols visible to all modules.
LIBRARY = ctypes.CDLL(str(_library()), mode=ctypes.RTLD_GLOBAL)

# Without this handler, MuJoCo would append its warnings to a file in the current folder.
mujoco.set_mju_user_warning(lambda text: log.warning("MuJoCo: %s", text))

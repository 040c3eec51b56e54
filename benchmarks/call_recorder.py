"""Records which functions of `app` and `cobot` each process calls, for the benchmark `request_path`.

`record(folder)` runs in each process before its own modules, from a `sitecustomize` module. The first byte of
the file `phase` in the folder says for which phase calls are recorded; 0: none. Each function is written once
for each process, phase and root, as a line of the file `calls`.
"""

from __future__ import annotations

import mmap
import os
import sys
import threading
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGES = (f"{ROOT}/app/", f"{ROOT}/cobot/")
EVENT_LOOP = ("uvicorn/server.py", "asyncio/runners.py")
"""Ends of the files that run the service's event loop. What called them is the start of the process."""
PHASE, CALLS = "phase", "calls"


def record(folder: str) -> None:
    """Record the calls of this process and of those that it forks."""
    with (Path(folder) / PHASE).open("r+b") as file:
        phase = mmap.mmap(file.fileno(), 1)
    calls = Path(folder) / CALLS
    seen: set[tuple[int, int, CodeType, CodeType]] = set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call" or not phase[0] or not code.co_filename.startswith(PACKAGES):
            return
        root = _root(frame)
        key = (os.getpid(), phase[0], root, code)
        if key not in seen:
            seen.add(key)
            with calls.open("a") as file:  # opened for each line, because forked processes close all files
                file.write(f"{key[0]}\t{key[1]}\t{_text(root)}\t{_text(code)}\n")

    sys.setprofile(note)
    threading.setprofile(note)


def _root(frame: FrameType) -> CodeType:
    """The outermost recorded function on the stack, which the event loop or a thread has called."""
    root, outer = frame.f_code, frame.f_back
    while outer is not None and not outer.f_code.co_filename.endswith(EVENT_LOOP):
        if outer.f_code.co_filename.startswith(PACKAGES):
            root = outer.f_code
        outer = outer.f_back
    return root


def _text(code: CodeType) -> str:
    return f"{code.co_filename.removeprefix(f'{ROOT}/')}:{code.co_firstlineno}:{code.co_qualname}"

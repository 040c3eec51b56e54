"""`cobot fleet pull`: copies recordings from the hub to this computer."""

from __future__ import annotations

import argparse
import json
import os
import re
from pathlib import Path
from urllib.parse import quote

import httpx2

from cobot.client.tls import tls_context
from cobot.errors import InputError, UnavailableError
from cobot.fleet.asking import ask, headers

EXIT_OK = 0
FILE_S = 30.0
PARTIAL, COMPLETE = 206, 416
"""HTTP status for the rest of a file, and HTTP status if the file is already complete."""


def pull(chosen: argparse.Namespace) -> int:
    """Copy recordings that do not exist on this computer yet. An interrupted copy is continued later."""
    found = ask(chosen, "GET", "/recordings")["recordings"]
    known = {each["cell"] for each in [*found, *ask(chosen, "GET", "/cells")["robots"]]}
    for cell in chosen.cells:
        if cell not in known:
            raise InputError(f"the hub has no cell {cell!r}; its cells: {', '.join(sorted(known)) or 'none'}")
    wanted = [each for each in found if not chosen.cells or each["cell"] in chosen.cells]
    new = []
    for each in wanted:
        names = [_plain(each[name]) for name in ("cell", "robot", "name")]
        file = chosen.folder.joinpath(*names)
        if not file.exists():
            _download(chosen, f"/recordings/{'/'.join(quote(name, safe='') for name in names)}", file)
            new.append("/".join(names))
            if not chosen.json:
                print(new[-1], flush=True)
    here = len(wanted) - len(new)
    print(
        json.dumps({"new": new, "already_here": here})
        if chosen.json
        else f"{len(new)} new, {here} already here"
    )
    return EXIT_OK


def _plain(name: str) -> str:
    """Check that a name is the name of a file or folder, without a path.

    Raises:
        InputError: the name would lead to a different folder.
    """
    if not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]*", name):
        raise InputError(f"the hub's recording has an invalid name: {name!r}")
    return name


def _download(chosen: argparse.Namespace, path: str, file: Path) -> None:
    """Download one file from the hub.

    Raises:
        UnavailableError: the hub does not answer. The next call continues the download.
        InputError: the file cannot be written.
    """
    part = file.with_name(f"{file.name}.part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(part, flags, 0o600), "ab") as out:
            asked = headers(chosen) | {"Range": f"bytes={out.tell()}-"}
            url = chosen.url.rstrip("/") + path
            with httpx2.stream(
                "GET", url, headers=asked, timeout=FILE_S, verify=tls_context(True), trust_env=False
            ) as response:
                if response.status_code not in (PARTIAL, COMPLETE):
                    raise UnavailableError(f"{path}: the hub answers with status {response.status_code}")
                for piece in response.iter_bytes() if response.status_code == PARTIAL else ():
                    out.write(piece)
        part.rename(file)
    except httpx2.HTTPError as exc:
        raise UnavailableError(f"{path}: {str(exc) or type(exc).__name__}; the next call continues") from exc
    except OSError as exc:
        raise InputError(f"{file}: cannot be written: {exc.strerror}") from exc

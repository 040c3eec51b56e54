"""The orders to a worker, and the check that the worker has the same version of cobot, the same models and
the same scene.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cobot
from cobot.errors import UnavailableError
from cobot.studies.chunks import as_columns, to_bytes
from cobot.studies.study import Kernel, Study
from cobot.studies.study_file import study_of

_KEPT = 2
"""Number of studies whose models a worker keeps."""


class ForeignWorkerError(UnavailableError):
    """Raised if a worker has a different version of cobot or different files, so that it must not compute."""


def keys_of_answer(document: Mapping[str, Any]) -> set[str]:
    """Keys of a document that affect its answer but not the results of its tasks."""
    keys = {"question", "confidence"}
    return keys if document.get("search") else keys | {"metric", "goal"}


@dataclass(frozen=True, slots=True)
class Order:
    """A study as it is sent to workers, which recreate it from its document. It can be pickled, even for
    workers on different computers.

    Attributes:
        contents: hashes of everything that the results depend on, by readable names.
        key: hash of the document and the contents.
    """

    document: dict[str, Any]
    folder: str
    contents: dict[str, str]
    key: str

    @classmethod
    def of(cls, study: Study) -> Order:
        contents = versions() | study.contents()
        said = {name: study.document[name] for name in study.document.keys() - keys_of_answer(study.document)}
        whole = json.dumps([said, contents], sort_keys=True, allow_nan=False, default=str)
        key = hashlib.sha256(whole.encode()).hexdigest()
        return cls(study.document, str(study.folder), contents, key)


@dataclass(frozen=True, slots=True)
class Filled:
    """The results of consecutive tasks, as the bytes of a chunk, and the total time of these tasks, s."""

    content: bytes
    busy_s: float


_warm: dict[str, tuple[Study, Kernel]] = {}


def fill(order: Order, first: int, last: int, points: list[dict[str, Any]] | None = None) -> Filled:
    """Compute the tasks from `first` up to `last` (excluded) in a worker.

    The models of a study are built once per worker.

    Args:
        points: see `cobot.studies.study.Round`.

    Raises:
        ForeignWorkerError: this worker has a different version or different files.
        CobotError: the study cannot be computed here.
    """
    if order.key not in _warm:
        built = _build(order)
        while len(_warm) >= _KEPT:
            del _warm[next(iter(_warm))]
        _warm[order.key] = built
    study, kernel = _warm[order.key]
    if points is not None:
        study.take_points(first, points)
    begin = time.perf_counter()
    columns = as_columns(kernel(first, last), last - first)
    busy_s = time.perf_counter() - begin
    return Filled(to_bytes(columns), busy_s)


def _build(order: Order) -> tuple[Study, Kernel]:
    own = versions()
    _require_same(order.contents, own)
    study = study_of(order.document, order.folder)
    _require_same(order.contents, own | study.contents())
    return study, study.kernel()


def _require_same(wanted: dict[str, str], own: dict[str, str]) -> None:
    """Check that this worker has the wanted versions. Names that occur only in `wanted` are names of files,
    which are compared later.
    """
    for name, value in own.items():
        if wanted.get(name) != value:
            import socket

            raise ForeignWorkerError(
                f"the worker on {socket.gethostname()} has a different {name}: {value[:16]}, but the "
                f"study needs {wanted.get(name, 'none')[:16]}; install the same version there, or use other "
                "workers"
            )


@cache
def versions() -> dict[str, str]:
    """Versions of the programs that affect the results of a study."""
    found = {name: version(name) for name in ("cobot", "mujoco-core", "numpy", "scipy")}
    python = ".".join(map(str, sys.version_info[:2]))
    code = {"source of cobot": _hash_of("*.py"), "compiled code of cobot": _hash_of("*.so")}
    return {**found, **code, "python": python}


def _hash_of(pattern: str) -> str:
    """Hash of one kind of cobot's files. Versions are not enough, because two checkouts or builds may have
    the same version.
    """
    root = Path(cobot.__file__).parent
    whole = hashlib.sha256()
    for package in (root, root.parent / "rtloop"):
        for path in sorted(package.rglob(pattern)):
            whole.update(str(path.relative_to(root.parent)).encode() + b"\0" + path.read_bytes())
    return whole.hexdigest()

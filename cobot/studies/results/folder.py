"""The folder with the results of a study.

    manifest.json      the question, the document, versions, hashes, seed
    chunks/            results of consecutive tasks: FIRST-LAST-HASH.npz, renamed into place
    results.sqlite     all results in one table, or results.parquet with the extra `study`
    answer.json        the answer
    map.png, map.html  the map, if the results are places

All files except the chunks contain the same bytes after any run of the same study. Only one process may write
at a time.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cobot.errors import ConfigError, ConflictError, UnavailableError, exhausted
from cobot.folders import open_new
from cobot.robot.kept import keep
from cobot.studies.chunks import Column, digest, from_bytes, joined
from cobot.studies.orders import Order, keys_of_answer
from cobot.studies.results.tables import PARQUET, SQLITE, write_table
from cobot.studies.study import MAX_TASKS, Study
from cobot.studies.study_file import study_of

MANIFEST, CHUNKS, ANSWER, LOCK = "manifest.json", "chunks", "answer.json", ".lock"
FILES = (ANSWER, SQLITE, PARQUET, "map.png", "map.html")
"""Files that a run of a study replaces."""
LOCK_FLAGS = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
FORMAT = 1
_NAME = re.compile(r"(\d{9})-(\d{9})-([0-9a-f]{32})\.npz")


class ChunkFile(NamedTuple):
    """A finished chunk: the tasks from `first` up to `last` (excluded)."""

    first: int
    last: int
    path: Path


class ResultsFolder:
    """One folder of results. The results may be incomplete."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)

    @contextmanager
    def writing(self, study: Study, order: Order) -> Iterator[None]:
        """Context manager that reserves the folder for the results of a study.

        Raises:
            ConflictError: the folder contains the results of another study, or another process is writing to
                it.
            UnavailableError: the folder cannot be written.
        """
        try:
            if not (self.path / MANIFEST).exists():
                self._require_own()
            (self.path / CHUNKS).mkdir(parents=True, exist_ok=True)
            descriptor = os.open(self.path / LOCK, LOCK_FLAGS, 0o600)
        except OSError as exc:
            raise _unwritable(self.path, exc) from exc
        try:
            self._lock(descriptor)
            self._settle_manifest(study, order)
            yield
        finally:
            os.close(descriptor)

    def _lock(self, descriptor: int) -> None:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as exc:
            owner = os.pread(descriptor, 20, 0).decode("ascii", "replace") or "unknown"
            raise ConflictError(
                f"{self.path}: process {owner} is computing this study; wait for it, or give another --output"
            ) from exc
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, str(os.getpid()).encode(), 0)

    def _settle_manifest(self, study: Study, order: Order) -> None:
        manifest = {
            "format": FORMAT,
            "question": study.question,
            "kind": study.kind,
            "seed": study.seed,
            "tasks": study.tasks,
            "key": order.key,
            "document": study.document,
            "contents": order.contents,
        }
        old = self.manifest() if (self.path / MANIFEST).exists() else manifest
        if old["key"] != order.key:
            raise ConflictError(
                f"{self.path}: contains results of another study ({_difference(old, manifest)}); give "
                "another --output, or remove the folder"
            )
        content = json.dumps(manifest, indent=1, sort_keys=True, default=str) + "\n"
        keep(self.path / MANIFEST, content.encode(), "the study")

    def _require_own(self) -> None:
        """Check that a folder without a manifest contains no files that this study would replace.

        Raises:
            ConflictError: it contains such a file.
        """
        for name in FILES:
            if (self.path / name).exists():
                raise ConflictError(
                    f"{self.path / name}: does not belong to a study, and would be replaced; give "
                    "another --output"
                )

    def manifest(self) -> dict[str, Any]:
        """Read the manifest.

        Raises:
            ConfigError: the folder contains no results of a study.
        """
        path = self.path / MANIFEST
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            if found["format"] != FORMAT:
                raise ConfigError(
                    f"{path}: has format {found['format']}, but this cobot reads the format {FORMAT}"
                )
            return dict(found)
        except FileNotFoundError as exc:
            raise ConfigError(
                f"{path}: there is no such file; give a folder that `cobot study FILE.yaml` has written"
            ) from exc
        except OSError as exc:
            raise ConfigError(f"{path}: cannot be read: {exc.strerror}") from exc
        except (ValueError, KeyError, TypeError) as exc:
            raise ConfigError(f"{path}: is not the manifest of a study: {exc}") from exc

    def study(self) -> Study:
        """The study whose results are in this folder, as needed to compute the answer. It is read from the
        manifest, so the original files are not needed.
        """
        return study_of(self.manifest()["document"], self.path, str(self.path / MANIFEST))

    def add(self, first: int, last: int, content: bytes) -> None:
        """Store a finished chunk. It is not flushed to the disk, because that may take longer than computing
        a chunk.

        If a power cut damages the file, its hash shows this.

        Raises:
            UnavailableError: the disk is full or cannot be written; earlier chunks are kept.
        """
        path = self.path / CHUNKS / f"{first:09}-{last:09}-{digest(content)[:32]}.npz"
        new = self.path / CHUNKS / "next.new"
        try:
            with open_new(new) as file:
                file.write(content)
            os.replace(new, path)
        except OSError as exc:
            raise _unwritable(path, exc) from exc

    def chunks(self, begin: int = 0, end: int = MAX_TASKS) -> list[ChunkFile]:
        """The finished chunks whose first task is at least `begin` and below `end`, in order and without
        overlaps. Damaged files are removed.
        """
        found: list[ChunkFile] = []
        with contextlib.suppress(FileNotFoundError):
            for path in sorted((self.path / CHUNKS).iterdir()):
                match = _NAME.fullmatch(path.name)
                if match is None:
                    continue
                first, last = int(match[1]), int(match[2])
                if not begin <= first < end or (found and first < found[-1].last):
                    continue
                if digest(path.read_bytes())[:32] == match[3]:
                    found.append(ChunkFile(first, last, path))
                else:
                    with contextlib.suppress(OSError):  # the permission to write here may be missing
                        path.unlink()
        return found

    def gaps(self, tasks: int, first: int = 0) -> list[tuple[int, int]]:
        """The ranges of unfinished tasks from `first` up to `tasks`.

        No range crosses the end of a round, because a chunk contains only tasks of one round.
        """
        begin, gaps = first, []
        for chunk in self.chunks(first, tasks):
            if chunk.first > begin:
                gaps.append((begin, chunk.first))
            begin = chunk.last
        if begin < tasks:
            gaps.append((begin, tasks))
        return gaps

    def columns(self, first: int = 0, last: int = MAX_TASKS) -> dict[str, Column]:
        """The results so far, and the numbers of their tasks; empty before the first result."""
        chunks = self.chunks(first, last)
        if not chunks:
            return {}
        tasks = np.concatenate([np.arange(chunk.first, chunk.last) for chunk in chunks])
        return {"task": tasks} | joined([from_bytes(chunk.path.read_bytes()) for chunk in chunks])

    def write_results(self, answer: Mapping[str, Any], columns: Mapping[str, Column]) -> Path:
        """Write the table and the answer. Returns the path of the table."""
        content = json.dumps(answer, indent=1) + "\n"
        keep(self.path / ANSWER, content.encode(), "the answer")
        return write_table(self.path, columns)


def _unwritable(path: Path, exc: OSError) -> UnavailableError:
    reason = exhausted(exc) or exc.strerror
    return UnavailableError(
        f"{path}: cannot be written: {reason}; finished results are kept; run the study again to continue"
    )


def _difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Describe the first key whose value differs. The keys of the document are compared first, then those of
    the contents.
    """
    for part in ("document", "contents"):
        for name in sorted(old[part].keys() | new[part].keys()):
            before, now = old[part].get(name), new[part].get(name)
            if before != now and name not in keys_of_answer(new["document"]):
                return f"{name} was {_brief(before)} and is now {_brief(now)}"
    return "the key differs"


def _brief(value: object) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= 40 else text[:40] + "..."

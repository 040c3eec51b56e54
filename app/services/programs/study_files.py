"""The studies of a robot on disk. Each has one folder with its status and its results."""

from __future__ import annotations

import contextlib
import logging
import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from cobot.errors import NotFoundError, UnavailableError
from cobot.robot.kept import keep, read_kept, size_of
from cobot.strict import shown

STATUS, MAP = "status.json", "map.json"
TABLES = ("results.parquet", "results.sqlite")
ID_PATTERN = r"^[0-9a-f]{12}$"
_ID = re.compile(ID_PATTERN)
log = logging.getLogger("cobot.studies")


@dataclass(frozen=True, slots=True)
class StudyStatus:
    """The status of a study.

    Attributes:
        state: running, finished, partial (it can be continued), or failed.
        reason: reason why the study is not finished; "" while it is running and after it has finished.
        answer: answer from the results so far, as values by displayed names.
        left_s: estimated remaining time, s; None while it is unknown.
        placement: for a placement study, the poses of the best base and TCP: x, y, z, w, x, y, z.
        maps: whether the study produces a map.
        job: id of the job of the last run.
    """

    id: str
    question: str
    kind: str
    document: dict[str, Any]
    owner: str
    started_at: str
    state: str = "running"
    reason: str = ""
    tasks: int = 0
    done: int = 0
    rate_hz: float = 0.0
    left_s: float | None = None
    answer: dict[str, Any] = field(default_factory=dict)
    placement: dict[str, list[float]] | None = None
    maps: bool = False
    job: str = ""


_STATUS = TypeAdapter(StudyStatus)


class StudyFiles:
    """The studies that are kept on disk. The methods block while they access the disk."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def total_bytes(self) -> int:
        """Size of all studies together, in bytes."""
        return size_of(self.folder)

    def keep(self, status: StudyStatus) -> None:
        """Write the status of a study.

        Raises:
            UnavailableError: the file cannot be written.
        """
        keep(self.folder / status.id / STATUS, _STATUS.dump_json(status), "the study")

    def delete(self, study: str) -> None:
        """Delete a study with its results.

        Raises:
            UnavailableError: the files cannot be deleted.
        """
        try:
            shutil.rmtree(self.folder / study)
        except OSError as exc:
            raise UnavailableError(f"study {study} cannot be deleted: {exc.strerror}") from exc

    def ids(self) -> list[str]:
        with contextlib.suppress(FileNotFoundError):
            return [path.name for path in self.folder.iterdir() if _ID.fullmatch(path.name)]
        return []

    def all(self) -> list[StudyStatus]:
        """List all studies with their last written status, newest first."""
        found = []
        for study in self.ids():
            try:
                found.append(self.read(study))
            except NotFoundError as exc:  # deleted in the meantime, or damaged
                log.warning("%s", exc)
        return sorted(found, key=lambda each: each.started_at, reverse=True)

    def read(self, study: str) -> StudyStatus:
        """Return one study with its last written status.

        Raises:
            NotFoundError: there is no such study.
        """
        if not _ID.fullmatch(study):
            raise NotFoundError(f"there is no study {shown(study)}; GET /studies lists them")
        try:
            return _STATUS.validate_json(read_kept(self.folder / study / STATUS))
        except (OSError, ValidationError) as exc:
            raise NotFoundError(f"there is no study {shown(study)}; GET /studies lists them") from exc

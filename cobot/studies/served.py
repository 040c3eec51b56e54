"""The process that computes one study of the service.

It reads a request from standard input, and writes lines of JSON to standard output: first `id` and `tasks`,
then the progress, and last `end` or an `error`. SIGTERM ends it with a partial answer. It computes with the
lowest priority, and ends with the service.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cobot.config.section import parse
from cobot.errors import CobotError, ConfigError, ConflictError, InputError, LimitError, exhausted
from cobot.foreign import plain_error
from cobot.launch.process import Niceness, die_with_parent, set_niceness
from cobot.robot.kept import keep, size_of
from cobot.strict import StrictModel, shown, unknown_key
from cobot.studies.chunks import Columns
from cobot.studies.kinds.placement import PlacementStudy
from cobot.studies.orders import Order
from cobot.studies.programs.sequence_program import SequenceProgram, program_of
from cobot.studies.results.folder import ResultsFolder
from cobot.studies.results.map_html import map_content
from cobot.studies.results.maps import map_columns
from cobot.studies.running import Advance, answer_of, run_study
from cobot.studies.study import Study
from cobot.studies.study_file import study_of

KINDS = ("reach", "placement", "cycle", "robustness", "compare")
"""Kinds of studies that a request may contain. Functions are not allowed, because they would be foreign
code.
"""
OF_THE_ROBOT = ("objects", "tool")
"""Keys that `robot` may contain in a request."""
COPIES = ("scene", "tool_file", "positions")
"""Files from the service whose content becomes part of a study, by their keys in `robot`."""
MAX_POINTS = 20_000
"""Maximum number of places in a map that the service shows."""
REPORT_S = 0.5
PARTIAL_S = 5.0
"""Minimum interval between partial answers, in seconds."""
PARTIAL_REST = 20.0
"""Minimum interval between partial answers, as a multiple of the time that one answer takes."""
ID_LENGTH = 12


class ServedRequest(StrictModel):
    """A request from the service to compute a study.

    Attributes:
        parent: process number of the service.
        document: the study, as in its file.
        stored: text of the stored program that `document` names, and its file name.
        base: folder of all studies.
        copies: content of the service's files that belong to the study, by `COPIES`.
        settings, robot: settings file, None for the shipped ones, and the name of one of its robots.
        map: map file name, in the study folder.
        may_create: whether the study may be a new one.
        niceness: niceness of the computation.
        max_bytes: maximum growth of the study's folder.
    """

    parent: int
    document: dict[str, Any]
    stored: tuple[str, str] | None
    base: str
    copies: dict[str, str]
    settings: str | None
    robot: str
    map: str
    workers: int
    niceness: int
    may_create: bool
    max_tasks: int
    max_bytes: int
    max_s: float


def main() -> int:
    """Serve one request."""
    os.umask(0o077)
    request = ServedRequest.model_validate_json(sys.stdin.buffer.read(), strict=False)
    die_with_parent(signal.SIGKILL)
    if os.getppid() != request.parent:
        return 1  # the parent died before the call above
    # Runs with a higher priority, because a client waits for its study to be checked.
    set_niceness(Niceness(min(request.niceness, Niceness.BACKGROUND)), session=True)
    cancel = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: cancel.set())
    try:
        _compute(request, cancel)
    except CobotError as exc:
        _tell(error={"code": exc.code, "detail": str(exc)})
    except (OSError, MemoryError) as exc:
        error = exhausted(exc) or CobotError(plain_error(exc))
        _tell(error={"code": error.code, "detail": str(error)})
    return 0


def _tell(**content: Any) -> None:
    print(json.dumps(finite(content), allow_nan=False), flush=True)


def finite(value: Any) -> Any:
    """The value with None instead of NaN and infinite numbers, because JSON has no such numbers."""
    if isinstance(value, dict):
        return {name: finite(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _compute(request: ServedRequest, cancel: threading.Event) -> None:
    study, folder = settle(request)
    results, tasks = ResultsFolder(folder), study.tasks
    if tasks > request.max_tasks:
        raise LimitError(f"the study has {tasks} tasks, allowed here: {request.max_tasks}")
    missing = sum(last - first for first, last in results.gaps(tasks))
    _tell(id=folder.name, tasks=tasks, done=tasks - missing, maps=study.maps)
    set_niceness(Niceness(request.niceness), session=True)
    watch = _Watch(request, study, results, cancel, size_of(folder))
    found = run_study(study, folder, workers=request.workers, report=watch.report, cancel=cancel)
    columns = results.columns()
    if study.maps:
        write_map(study, folder / request.map, columns)
    _tell(
        end={
            "answer": found.answer,
            "done": found.done,
            "tasks": found.tasks,
            "reason": watch.reason,
            "placement": study.best_placement(columns) if isinstance(study, PlacementStudy) else None,
        }
    )


def settle(request: ServedRequest) -> tuple[Study, Path]:
    """Create the study of a request and its folder, and return both.

    The folder name is derived from the study's content, so the same study continues in the same folder.

    Raises:
        CobotError: the request is invalid, or it needs a new folder and there are too many folders.
    """
    base = Path(request.base)
    base.mkdir(mode=0o700, parents=True, exist_ok=True)
    new = base / f".new-{os.getpid()}"
    for left in base.glob(".new-*"):
        shutil.rmtree(left, ignore_errors=True)
    new.mkdir(mode=0o700)
    try:
        document = _document(request, new)
        try:
            key = Order.of(study_of(document, new)).key[:ID_LENGTH]
        except ConfigError as exc:  # the message leaves out the folder, which no client has chosen
            raise InputError(str(exc).replace(f"{new}/", "")) from exc
        folder = base / key
        if not folder.exists():
            if not request.may_create:
                raise ConflictError(
                    "there are too many studies; delete one: DELETE /studies/ID", details={"cause": "full"}
                )
            os.replace(new, folder)
        return study_of(document, folder), folder
    finally:
        shutil.rmtree(new, ignore_errors=True)


def _document(request: ServedRequest, folder: Path) -> dict[str, Any]:
    """The document with the robot of the service and the robot's current scene, tool and positions."""
    document = dict(request.document)
    require_no_files(document)
    if document["kind"] == "compare":
        for place, part in _parts(document).items():
            require_no_files(part, f"{place}.")
    if isinstance(choice := document.get("program"), dict):
        document["program"] = _stored_program(request, choice)
    robot = {"name": request.robot} | ({} if request.settings is None else {"settings": request.settings})
    for key in COPIES:
        if key in request.copies:
            keep(folder / f"{key}.json", request.copies[key].encode(), "the study")
            robot[key] = f"{key}.json"
    holder = document
    if document["kind"] == "compare":
        holder = document["study"] = dict(document["study"])
    holder["robot"] = robot | dict(holder.get("robot") or {})
    return document


def _parts(document: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The studies in a comparison, by their locations in the document."""
    variants = document.get("variants")
    parts = (
        {f"variants.{name}": each for name, each in variants.items()} if isinstance(variants, dict) else {}
    )
    if not isinstance(document.get("study"), dict):
        raise InputError("study: is missing; give the keys that all variants have in common")
    return {
        place: part
        for place, part in ({"study": document["study"]} | parts).items()
        if isinstance(part, dict)
    }


def require_no_files(part: dict[str, Any], place: str = "") -> None:
    """Check that a part of a request refers neither to a function nor to a file on this computer.

    Raises:
        InputError: it names one; the message gives the alternative.
    """
    kind = part.get("kind", KINDS[0] if place.startswith("variants") else None)
    if kind not in KINDS or (place and kind == "compare"):
        raise InputError(f"{place}kind: must be one of {', '.join(KINDS)}, got {shown(kind)}")
    robot = part.get("robot")
    if isinstance(robot, dict):
        for key in robot:
            if key not in OF_THE_ROBOT:
                raise InputError(
                    f"{place}robot: unknown key {shown(key)}; a study in the service uses its own robot, "
                    f"scene and positions; valid names: {', '.join(OF_THE_ROBOT)}"
                )
    for name in ("space", "targets"):
        if isinstance(value := part.get(name), dict) and "mesh" in value:
            raise InputError(f"{place}{name}.mesh: a study in the service cannot read files; use {name}.box")
    program = part.get("program")
    if isinstance(program, dict) and (place or "stored" not in program):
        raise InputError(
            f"{place}program: a study in the service cannot read files; list the moves, or name a stored "
            f"program with {{stored: ID}}"
        )
    if "function" in part:
        raise InputError(f"{place}function: a study in the service cannot call functions; use `cobot study`")


def _stored_program(request: ServedRequest, choice: dict[str, Any]) -> list[dict[str, Any]]:
    if request.stored is None:
        raise InputError("program.stored: there is no such program")
    for key in choice:
        if key not in ("stored", "moves"):
            raise InputError(f"program: {unknown_key(key, ['stored', 'moves'])}")
    given = {"file": "stored", "moves": choice.get("moves", {})}
    moves = parse(SequenceProgram, Path("study"), given, "program: ").moves
    text, name = request.stored
    return program_of(text, name, moves)


@dataclass(slots=True)
class _Watch:
    """Reports the progress of a run, and ends the run at its limits.

    Attributes:
        reason: the reason why the run has ended before all tasks were done; "" for a cancel.
    """

    request: ServedRequest
    study: Study
    results: ResultsFolder
    cancel: threading.Event
    bytes_before: int
    reason: str = ""
    begin_s: float = field(default_factory=time.monotonic)
    next_s: float = 0.0
    next_partial_s: float = field(default_factory=lambda: time.monotonic() + PARTIAL_S)

    def report(self, advance: Advance) -> None:
        now_s = time.monotonic()
        if now_s < self.next_s or self.cancel.is_set():
            return
        self.next_s = now_s + REPORT_S
        _tell(done=advance.done, rate_hz=advance.rate_hz, left_s=advance.left_s)
        if now_s - self.begin_s > self.request.max_s:
            self._end(f"the time limit of {self.request.max_s:g} s was reached (max_s)")
        elif now_s >= self.next_partial_s:
            self._report_answer()
            self.next_partial_s = time.monotonic() + max(PARTIAL_S, PARTIAL_REST * (time.monotonic() - now_s))

    def _report_answer(self) -> None:
        grown = size_of(self.results.path) - self.bytes_before
        if grown > self.request.max_bytes:
            self._end(
                f"its results take {grown} bytes, but only {self.request.max_bytes} are left for studies"
            )
            return
        columns = self.results.columns()
        if columns:
            _tell(answer=answer_of(self.study, columns, self.study.tasks))
            if self.study.maps:
                write_map(self.study, self.results.path / self.request.map, columns)

    def _end(self, reason: str) -> None:
        self.reason = reason
        self.cancel.set()


def write_map(study: Study, file: Path, columns: Columns) -> None:
    """Write a map of the results that exist so far."""
    found = map_columns(study, columns, MAX_POINTS)
    if found is None:
        return
    content = map_content(found.columns, found.metrics, found.spacing_m) | {
        "metrics": found.metrics,
        "every": found.every,
    }
    keep(file, json.dumps(finite(content), allow_nan=False).encode(), "the map")


if __name__ == "__main__":
    sys.exit(main())

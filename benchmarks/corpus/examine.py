"""One description from file to motion: `cobot new-robot`, `cobot check`, then motions.

    python -m benchmarks.corpus.examine move|convert FILE FOLDER [options of cobot new-robot]

prints one line of JSON. Each description has a process of its own, which bounds time and memory and makes a
crash in a library a result too.
"""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.any_arm import measure
from benchmarks.corpus.real import Description
from cobot.launch.cli import main as cobot

TIMEOUT_S = 900.0
"""Maximum time for one description; anything longer counts as hung."""
CONVERTED, REFUSED, CRASHED, HUNG = "converted", "refused", "crashed", "hung"


@dataclass(slots=True)
class Outcome:
    """The outcome for one description.

    Attributes:
        conversion: one of CONVERTED, REFUSED, CRASHED, HUNG.
        said: what `cobot new-robot` printed.
        check: "" if `cobot check` passed, otherwise the lines that failed.
        moved: figures of `benchmarks.any_arm.measure` in words; "" if the arm was not moved.
        good: whether the arm held still and completed every motion that was started, tracking as the iiwa.
        refused: number of motions for which no goal was found that the planner accepts.
        seconds: time for all of it.
    """

    name: str
    conversion: str
    said: str
    check: str = ""
    moved: str = ""
    good: bool = False
    refused: int = 0
    seconds: float = 0.0


def examine_all(
    descriptions: list[Description], folder: Path, processes: int, *, move: bool
) -> Iterator[Outcome]:
    """Examines each description in a process of its own, several at a time."""
    with ThreadPoolExecutor(processes) as pool:
        yield from pool.map(lambda each: _examine_apart(each, folder, move), descriptions)


def _examine_apart(description: Description, folder: Path, move: bool) -> Outcome:
    into = folder / description.name
    into.parent.mkdir(parents=True, exist_ok=True)
    command = [
        sys.executable,
        "-m",
        "benchmarks.corpus.examine",
        "move" if move else "convert",
        description.file,
        into,
        *description.options,
    ]
    began = time.monotonic()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        outcome = Outcome(**json.loads(done.stdout.splitlines()[-1]))
    except subprocess.TimeoutExpired:
        outcome = Outcome("", HUNG, f"no end within {TIMEOUT_S:g} s")
    except (IndexError, ValueError):
        outcome = Outcome("", CRASHED, f"exit {done.returncode}: {done.stderr[-2000:]}")
    outcome.name, outcome.seconds = description.name, time.monotonic() - began
    return outcome


def examine(file: Path, folder: Path, options: list[str], *, move: bool) -> Outcome:
    """Converts, checks and, if asked, moves one description in this process."""
    status, said = _run("new-robot", str(file), "--output", str(folder), *options)
    if status == CRASHED or status != "0":
        return Outcome("", CRASHED if status == CRASHED else REFUSED, said)
    status, report = _run("check", "--config", str(folder))
    outcome = Outcome("", CONVERTED, said)
    if status != "0":
        failed = [line for line in report.splitlines() if not line.startswith("ok")]
        outcome.check = "\n".join(failed) or report
    if outcome.check or not move:
        return outcome
    figures = measure(folder)
    outcome.moved, outcome.good = str(figures), figures.good
    outcome.refused = sum(figures.refused.values())
    return outcome


def _run(*words: str) -> tuple[str, str]:
    """Run a command of cobot. Returns its exit status or CRASHED, and everything that it has printed."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        try:
            status = str(cobot(list(words)))
        except SystemExit as end:
            status = str(end.code or 0)
        except BaseException:  # noqa: BLE001  every exception that escapes is a result
            return CRASHED, printed.getvalue() + traceback.format_exc()
    return status, printed.getvalue()


if __name__ == "__main__":
    result = examine(Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:], move=sys.argv[1] == "move")
    print(json.dumps(asdict(result)))

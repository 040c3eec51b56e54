"""`cobot study`: runs a study from its file, and shows its results."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cobot.commands.terminal import Bar, show
from cobot.errors import CobotError, UnavailableError
from cobot.foreign import plain_lines
from cobot.launch.process import as_command
from cobot.studies.engines.engine import LOCAL, engine
from cobot.studies.orders import Order
from cobot.studies.results.folder import ResultsFolder
from cobot.studies.results.maps import write_maps
from cobot.studies.running import Advance, StudyResult, answer_of, run_study
from cobot.studies.study_file import load_study

EXIT_OK, EXIT_FAILED, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130
DESCRIPTION = """\
Answer a question about a robot that needs thousands of computations: docs/studies.md.

  cobot study FILE.yaml      compute the missing results, and answer; run it again to continue
  cobot study show FOLDER    answer from the results so far, also during a run, and draw the maps"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    showing = words[:1] == ["show"]
    chosen = (_show_parser() if showing else _parser()).parse_args(words[1:] if showing else words)
    try:
        return _show(chosen) if showing else _run(chosen)
    except CobotError as exc:
        print(f"cobot: {plain_lines(exc)}", file=sys.stderr)
        return EXIT_FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "cobot study", description=DESCRIPTION, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("file", type=Path, metavar="FILE.yaml", help="the study; or `show` and a FOLDER")
    parser.add_argument(
        "--output",
        type=Path,
        metavar="FOLDER",
        help="folder of the results; by default a new one for each study, named after FILE",
    )
    parser.add_argument(
        "--workers", type=_positive, metavar="N", help="number of processes; by default one per core"
    )
    parser.add_argument(
        "--nice", type=_niceness, metavar="N", default=0, help="niceness of the processes, 0 to 19"
    )
    parser.add_argument(
        "--engine",
        metavar="ENGINE",
        default=LOCAL,
        help="where to compute: local, or dask://HOST:PORT for the scheduler of a Dask cluster "
        "(cobot[study])",
    )
    parser.add_argument("--json", action="store_true", help="print the answer as one JSON document")
    return parser


def _show_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "cobot study show", description="Show the answer from the results in a folder."
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="folder with the results")
    parser.add_argument("--json", action="store_true", help="print the answer as one JSON document")
    return parser


def _positive(text: str) -> int:
    value = int(text) if text.isdecimal() else 0
    if not 1 <= value <= 1024:
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer from 1 to 1024")
    return value


def _niceness(text: str) -> int:
    if not text.isdecimal() or int(text) > 19:
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer from 0 to 19")
    return int(text)


def _run(chosen: argparse.Namespace) -> int:
    study = load_study(chosen.file)
    folder = chosen.output or Path(f"{chosen.file.stem}-{Order.of(study).key[:8]}")
    cancel = threading.Event()
    before = {
        number: signal.signal(number, lambda *_: cancel.set()) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        bar = Bar(not chosen.json)
        with engine(chosen.engine, chosen.workers, chosen.nice) as used, bar.showing(study.question):
            result = run_study(
                study,
                folder,
                executor=used.executor,
                workers=used.workers,
                niceness=chosen.nice,
                report=lambda advance: _report(bar, study.question, advance),
                cancel=cancel,
            )
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    results = ResultsFolder(folder)
    maps = write_maps(study, results, result.answer, results.columns())
    files = [*([result.table] if result.table else []), *maps]
    _tell(chosen, study.question, result.answer, files)
    if not chosen.json:
        _tell_run(result, used.workers)
    if result.done and result.answer.get("failed tasks") == result.done:
        return EXIT_FAILED
    return EXIT_OK if result.complete else EXIT_INTERRUPTED


def _report(bar: Bar, question: str, advance: Advance) -> None:
    """Print the progress of this run. The bar uses it to estimate the remaining time."""
    missing = advance.tasks - (advance.done - advance.computed)
    bar.update(advance.computed, missing, f"{question[:40]} {advance.rate_hz:.3g}/s")


def _show(chosen: argparse.Namespace) -> int:
    folder = ResultsFolder(chosen.folder)
    study = folder.study()
    columns = folder.columns()
    answer = answer_of(study, columns, int(folder.manifest()["tasks"]))
    try:
        maps = write_maps(study, folder, answer, columns)
    except UnavailableError as exc:  # for example, the folder belongs to another user
        print(f"cobot: the maps are not drawn: {plain_lines(exc)}", file=sys.stderr)
        maps = []
    _tell(chosen, study.question, answer, maps)
    return EXIT_OK


def _tell(chosen: argparse.Namespace, question: str, answer: dict[str, Any], files: list[Path]) -> None:
    if chosen.json:
        print(json.dumps({"question": question, "answer": answer, "files": [str(path) for path in files]}))
        return
    show(question, "bold")
    width = max(map(len, answer))
    for name, value in answer.items():
        show(f"  {name:{width}}  {_words(value)}")
    for path in files:
        show(f"  {path}")


def _words(value: object) -> str:
    if isinstance(value, dict):
        return "; ".join(f"{name}: {_words(each)}" for name, each in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _tell_run(result: StudyResult, workers: int) -> None:
    if result.computed:
        rate = result.computed / result.duration_s
        show(
            f"{result.computed} tasks in {result.duration_s:.1f} s on {workers} workers: "
            f"{rate / workers:.4g} tasks/s per worker; the workers computed for {result.kernel_share:.0%} "
            "of the time"
        )
    if result.lost:
        show(f"{result.lost} times a worker died, and its tasks were computed again")
    if not result.complete:
        show(
            f"{result.tasks - result.done} of {result.tasks} tasks are missing: "
            "run the same command to continue"
        )


if __name__ == "__main__":
    sys.exit(as_command(main))

"""`python -m benchmarks corpus`: robot descriptions, from the file to motion.

156 descriptions that other people have written and 96 that are drawn at random go through `cobot new-robot`
and `cobot check`. Each arm that passes is simulated on the virtual clock: it has to hold still in random
postures and to complete random ptp, lin and ompl motions at full speed. The first table has a line for each
description that fails anywhere, the second one the shares.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchmarks.corpus import fuzz
from benchmarks.corpus.examine import CONVERTED, REFUSED, Outcome, examine_all
from benchmarks.corpus.made import made_descriptions
from benchmarks.corpus.real import Description, installed, real_descriptions

SUMMARY = (
    "| Kind | Described | Converted | Pass check | Move | Motions refused | Median time, s "
    "| Largest time, s |\n"
    "|---|---|---|---|---|---|---|---|"
)


def main(words: Sequence[str]) -> int:
    """Print the table. Returns 1 if the outcome for a description is not the expected one, or if an arm has
    failed to move.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks corpus", description=__doc__)
    parser.add_argument("--only", default="", metavar="TEXT", help="descriptions whose name contains it")
    parser.add_argument("--kind", choices=("real", "made"), help="without it: both")
    parser.add_argument("--convert", action="store_true", help="only convert and check, move nothing")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, metavar="N")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep files and outcomes.jsonl there")
    parser.add_argument("--fuzz", type=int, metavar="N", help="instead: N descriptions broken at random")
    parser.add_argument("--seed", type=int, default=0, help="of --fuzz")
    arguments = parser.parse_args(words)
    if arguments.fuzz is not None:
        return fuzz.run(arguments.fuzz, arguments.seed)
    if arguments.kind != "made" and not installed():
        parser.error("the real descriptions are not installed: `make corpus` does it; or choose --kind made")
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.keep or Path(scratch)
        chosen = [each for each in _descriptions(folder, arguments.kind) if arguments.only in each.name]
        outcomes = _examined(chosen, folder, arguments.processes, move=not arguments.convert)
    return _report(chosen, outcomes, moved=not arguments.convert)


def _examined(chosen: list[Description], folder: Path, processes: int, *, move: bool) -> list[Outcome]:
    """Examine the descriptions. Each outcome is written to the folder as soon as it is known, because the
    whole corpus takes hours.
    """
    outcomes = []
    with (folder / "outcomes.jsonl").open("a", encoding="utf-8") as written:
        for outcome in examine_all(chosen, folder / "robots", processes, move=move):
            outcomes.append(outcome)
            print(json.dumps(asdict(outcome)), file=written, flush=True)
            print(
                f"{len(outcomes)} of {len(chosen)}: {outcome.name}, {outcome.seconds:.0f} s", file=sys.stderr
            )
    return outcomes


def _descriptions(folder: Path, kind: str | None) -> list[Description]:
    made = [] if kind == "real" else list(made_descriptions(folder / "made"))
    return made + ([] if kind == "made" else list(real_descriptions(folder / "real")))


def _report(descriptions: list[Description], outcomes: list[Outcome], *, moved: bool) -> int:
    pairs = list(zip(descriptions, outcomes, strict=True))
    failures = [
        (outcome, reason) for each, outcome in pairs if (reason := _failure(each, outcome, moved=moved))
    ]
    print("| Description | Conversion | What failed |\n|---|---|---|")
    for outcome, reason in failures:
        print(f"| {outcome.name} | {outcome.conversion} | {reason} |")
    print(f"\n{SUMMARY}")
    for kind in ("real", "made"):
        if those := [outcome for outcome in outcomes if outcome.name.startswith("made/") == (kind == "made")]:
            print(_summary(kind, those))
    return 1 if failures else 0


def _failure(description: Description, outcome: Outcome, *, moved: bool) -> str:
    """The difference from the expected outcome; "" if there is none."""
    if outcome.conversion == REFUSED and description.refused is not None:
        return (
            ""
            if description.refused in outcome.said
            else f"refused for another reason: {_last(outcome.said)}"
        )
    if outcome.conversion != CONVERTED:
        return _last(outcome.said)
    if description.refused is not None:
        return f"was expected to be refused: {description.refused}"
    if outcome.check:
        expected = description.check is not None and description.check in outcome.check
        return "" if expected else f"cobot check: {outcome.check}"
    if description.check is not None:
        return f"was expected to fail cobot check: {description.check}"
    return "" if outcome.good or not moved else outcome.moved


def _last(said: str) -> str:
    return " ".join(said.strip().splitlines()[-1:])


def _summary(kind: str, outcomes: list[Outcome]) -> str:
    converted = [outcome for outcome in outcomes if outcome.conversion == CONVERTED]
    passed = [outcome for outcome in converted if not outcome.check]
    seconds = [outcome.seconds for outcome in passed]
    return (
        f"| {kind} | {len(outcomes)} | {len(converted)} | {len(passed)} of {len(converted)} "
        f"| {sum(outcome.good for outcome in passed)} of {len(passed)} "
        f"| {sum(outcome.refused for outcome in passed)} "
        f"| {np.median(seconds) if seconds else 0.0:.1f} | {max(seconds, default=0.0):.1f} |"
    )

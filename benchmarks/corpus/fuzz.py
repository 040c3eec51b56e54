"""`python -m benchmarks corpus --fuzz N`: robot descriptions with random errors.

Real files and made ones are changed in bytes, numbers, attributes and elements. `cobot new-robot` must make a
robot of each, or refuse it with one sentence that begins with the file. Each file has a process of its own,
with bounded time and memory.
"""

from __future__ import annotations

import os
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import NoReturn
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from benchmarks.corpus.made import KINDS, made_descriptions
from benchmarks.corpus.real import ENVIRONMENT
from cobot.launch.cli import main as cobot

TIMEOUT_S, MAX_MEMORY_GB = 120, 6
MAX_SOURCE_BYTES = 40_000
MOVABLE = re.compile(rb'type *= *"(revolute|continuous|prismatic)"')
SHOWN = 60
"""Characters of a reason that is listed because it has no place."""
MADE, REFUSED = "made", "refused"
PLACE = re.compile(r":\d+: |'|--(tcp|mass|actuators)")
"""A refusal has the line, or the name of the joint, link or element that it is about."""
VALUES = (
    "", "nan", "inf", "-0x1", "1e999", "-1e308", "1 2", "1 2 3 4", "0", "0 0 0", "-1", "1e14", "1e-14", "-",
    "1,5", "true", "none", "a" * 3000, "\u0664", "..", "/dev/zero", "package://", "\ud7ff\t\n", "&#0;",
    "(", "{}",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Result:
    """The result of `cobot new-robot` for a file. `wrong` is "" if the result is acceptable."""

    name: str
    ended: str
    said: str
    wrong: str
    seconds: float


def sources(folder: Path) -> list[Path]:
    """Files that the tests contain, to be broken: generated files, files of installed packages, and files of
    this repository.
    """
    import franky_sim
    import gymnasium

    made = [each.file for each in made_descriptions(folder, len(KINDS))]
    root, assets = Path(__file__).parents[2], Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
    real = [
        Path(franky_sim.__file__).parent / "assets" / "fr3_clean.urdf",
        assets / "pusher_v5.xml",
        assets / "reacher.xml",
        root / "config" / "iiwa14.xml",
        root / "examples" / "rail_arm" / "rail_arm.urdf",
    ]
    return [*made, *real]


def _of_corpus(folder: Path) -> Iterator[Path]:
    """The files of the corpus that have joints, if the corpus is installed. Meshes are replaced by spheres,
    because a broken file is in a different folder.

    Meshes become spheres, because a broken file is in another folder.
    """
    folder.mkdir()
    for number, source in enumerate(sorted(ENVIRONMENT.rglob("*.urdf")) if ENVIRONMENT.exists() else ()):
        content = source.read_bytes()
        if len(content) < MAX_SOURCE_BYTES and re.search(
            rb'type *= *"(revolute|continuous|prismatic)"', content
        ):
            file = folder / f"{number}_{source.name}"
            file.write_bytes(re.sub(rb"<mesh [^>]*/>", b'<sphere radius="0.02"/>', content))
            yield file


def broken(content: bytes, chance: Random) -> bytes:
    """A copy of a file with one to three random changes."""
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        content = chance.choice(CHANGES)(content, chance)
    return content


def _change_bytes(content: bytes, chance: Random) -> bytes:
    found = bytearray(content)
    for _ in range(chance.randrange(1, 6) if found else 0):
        found[chance.randrange(len(found))] = chance.randrange(256)
    return bytes(found)


def _cut(content: bytes, chance: Random) -> bytes:
    return content[: chance.randrange(len(content) + 1)]


def _in_tree(change: Callable[[Element, Random], None]) -> Callable[[bytes, Random], bytes]:
    """Change the parsed file. A file that is no longer XML stays as it is."""

    def changed(content: bytes, chance: Random) -> bytes:
        try:
            root = ElementTree.fromstring(content)
        except (ElementTree.ParseError, ValueError, LookupError):
            return content
        change(root, chance)
        return bytes(ElementTree.tostring(root, encoding="utf-8"))

    changed.__name__ = change.__name__
    return changed


def _with_attributes(root: Element) -> list[Element]:
    return [element for element in root.iter() if element.attrib]


def _set_attribute(root: Element, chance: Random) -> None:
    element = chance.choice(_with_attributes(root) or [root])
    element.set(chance.choice([*element.attrib, "name"]), chance.choice(VALUES))


def _remove_attribute(root: Element, chance: Random) -> None:
    if found := _with_attributes(root):
        element = chance.choice(found)
        del element.attrib[chance.choice([*element.attrib])]


def _exchange_attributes(root: Element, chance: Random) -> None:
    if found := _with_attributes(root):
        first, second = chance.choice(found), chance.choice(found)
        first.set(chance.choice([*first.attrib]), chance.choice([*second.attrib.values()]))


def _scale_number(root: Element, chance: Random) -> None:
    numbers = [
        (element, name)
        for element in root.iter()
        for name, value in element.attrib.items()
        if re.fullmatch(r"[-+\d.e ]*\d[-+\d.e ]*", value)
    ]
    if not numbers:
        return
    element, name = chance.choice(numbers)
    words = element.get(name, "").split()
    index, factor = (
        chance.randrange(len(words)),
        chance.choice((-1.0, 1e-9, 1e-3, 0.5, 1.1, 2.0, 10.0, 1e3, 1e12)),
    )
    try:
        words[index] = repr(float(words[index]) * factor)
    except ValueError:
        return
    element.set(name, " ".join(words))


def _remove_element(root: Element, chance: Random) -> None:
    if parents := [element for element in root.iter() if len(element)]:
        parent = chance.choice(parents)
        parent.remove(chance.choice(list(parent)))


def _copy_element(root: Element, chance: Random) -> None:
    """Copy an element to a random place, sometimes several levels deep into itself."""
    every = list(root.iter())
    element = chance.choice(every)
    copied = ElementTree.fromstring(ElementTree.tostring(element))
    chance.choice(every).append(copied)


def _rename_element(root: Element, chance: Random) -> None:
    every = list(root.iter())
    chance.choice(every).tag = chance.choice([chance.choice(every).tag, "replicate", "include", "nothing"])


CHANGES: tuple[Callable[[bytes, Random], bytes], ...] = (
    _change_bytes,
    _cut,
    *map(_in_tree, 3 * (_set_attribute, _scale_number)),
    *map(
        _in_tree, (_remove_attribute, _exchange_attributes, _remove_element, _copy_element, _rename_element)
    ),
)


def judge(code: int, said: str, file: Path, robot: Path) -> str:
    """The problem with the result of `cobot new-robot`; "" if there is none."""
    if code not in (0, 1):
        return f"exit status {code}"
    if robot.exists() != (code == 0):
        return "the folder is there although it was refused" if code else "there is no folder"
    if code == 0:
        return ""
    lines = said.strip().splitlines()
    if "Traceback" in said or not lines[-1:] or not lines[-1].startswith("cobot: "):
        return "no sentence"
    return "" if str(file) in lines[-1] else "the sentence does not name the file"


def broken_files(files: list[Path], folder: Path, count: int, seed: int) -> Iterator[Path]:
    """Yield broken files, each of which is written when it is requested. The same seed always gives the same
    files.
    """
    for number in range(count):
        chance = Random(f"{seed} {number}")
        source = chance.choice(files)
        file = folder / f"{number}_{source.name}"
        file.write_bytes(broken(source.read_bytes(), chance))
        yield file


def run(count: int, seed: int = 0) -> int:
    """Print the results. Returns 1 if any result is not acceptable."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        files = [*sources(folder / "made"), *_of_corpus(folder / "real")]
        results = []
        for file in broken_files(files, folder, count, seed):
            results.append(result := _apart(file, folder / "robot"))
            if result.wrong:
                kept = Path(tempfile.mkdtemp(prefix="cobot-fuzz-")) / file.name
                kept.write_bytes(file.read_bytes())
                print(f"{kept}: {result.wrong}: {result.said[-600:]}", flush=True)
    _report(results, len(files))
    return 1 if any(result.wrong for result in results) else 0


def _report(results: list[Result], files: int) -> None:
    ended = Counter(result.ended for result in results)
    refusals = [result for result in results if result.ended == REFUSED]
    placed = sum(bool(PLACE.search(result.said)) for result in refusals)
    print("| Broken files | Of | Made | Refused | of these with the place | Wrong | Largest time, s |")
    print("|---|---|---|---|---|---|---|")
    print(
        f"| {len(results)} | {files} | {ended[MADE]} | {ended[REFUSED]} | {placed} "
        f"| {sum(bool(result.wrong) for result in results)} "
        f"| {max((result.seconds for result in results), default=0.0):.1f} |"
    )
    others = (result.said for result in refusals if not PLACE.search(result.said))
    without = {re.sub(r"^.*?: ", "", said.removeprefix("cobot: "))[:SHOWN] for said in others}
    for reason in sorted(without):
        print(f"- {reason}")


def _apart(file: Path, robot: Path) -> Result:
    """Run a function in a forked process, which does not have to import the libraries again."""
    began = time.monotonic()
    with tempfile.TemporaryFile() as said, tempfile.TemporaryDirectory(dir=robot.parent) as place:
        robot = Path(place) / "robot"
        if (process := os.fork()) == 0:
            _make(file, robot, said.fileno())
        _, status = os.waitpid(process, 0)
        code = os.waitstatus_to_exitcode(status)
        said.seek(0)
        text = said.read().decode(errors="replace").strip()
        wrong = "takes too long" if code == -signal.SIGALRM else judge(code, text, file, robot)
        seconds = time.monotonic() - began
        ended = {0: MADE, 1: REFUSED}.get(code, "crashed")
        return Result(file.name, ended, text if wrong else "".join(text.splitlines()[-1:]), wrong, seconds)


def _make(file: Path, robot: Path, output: int) -> NoReturn:
    code = 3
    try:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(TIMEOUT_S)
        limit = MAX_MEMORY_GB << 30
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        os.dup2(output, 1)
        os.dup2(output, 2)
        code = cobot(["new-robot", str(file), "--output", str(robot)])
    except BaseException:  # noqa: BLE001  every exception that escapes is a result
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)

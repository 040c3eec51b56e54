"""Names and sentences of the code. Oracle: the rules of docs/contributing.md, "Names and sentences"."""

from __future__ import annotations

import ast
import re
import tokenize
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("cobot", "rtloop", "app")
IRREGULAR = {
    *("begun", "built", "chosen", "done", "drawn", "driven", "found", "given", "gone", "held"),
    *("kept", "known", "led", "left", "lost", "made", "met", "said", "seen", "sent", "shown"),
    *("spoken", "taken", "taught", "thrown", "told", "understood", "worn", "written"),
}
ADJECTIVES = frozenset({"named", "closed", "occurred", "unexpected"})
"""`move_named` is an endpoint's name, `wait_closed` is asyncio's, `is_collision_occurred` the vendor's."""


IDIOMS = re.compile(
    r"\b(is said|says so|(is|are) told|goes by|held against|whoever|somebody|nobody|anybody|what is none|"
    r"anew|beside|at the (most|least)|as shipped|shall|for it is|of one piece|who (asks|has|is|may|wants))\b",
    re.IGNORECASE,
)
"""What style.md has a plain word for."""
FRAGMENT = re.compile(r"(So (long|many|far|much|often|near)|Of|The same|Likewise|And|As|Or|Without|Beyond) ")
"""A caption that begins so only finishes the sentence of the name above it."""


def is_participle(word: str) -> bool:
    return word not in ADJECTIVES and (
        word in IRREGULAR or (word.endswith("ed") and not word.endswith("eed"))
    )


def awaited_functions(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.AsyncFunctionDef):
            yield node.name


def test_a_participle_is_recognised() -> None:
    source = "async def _started(): ...\nasync def begin(): ...\nasync def feed(): ..."
    found = list(awaited_functions(source))
    assert [is_participle(name.split("_")[-1]) for name in found] == [True, False, False]


@pytest.mark.parametrize("package", PACKAGES)
def test_what_is_awaited_is_a_verb(package: str) -> None:
    """An async function does something: `acknowledge`, not `acknowledged`."""
    wrong = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in sorted((ROOT / package).rglob("*.py"))
        for name in awaited_functions(path.read_text(encoding="utf-8"))
        if is_participle(name.split("_")[-1])
    ]
    assert wrong == []


def sentences_of(path: Path) -> Iterator[str]:
    """All comments and strings of a module."""
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type in (tokenize.COMMENT, tokenize.STRING):
                yield token.string


def captions_of(source: str) -> Iterator[str]:
    """The strings below assignments, which explain them."""
    for node in ast.walk(ast.parse(source)):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            for before, each in pairwise(body):
                explains = isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant)
                if explains and isinstance(before, ast.Assign | ast.AnnAssign):
                    yield str(each.value.value)


def findings(path: Path) -> Iterator[str]:
    """Each idiom and each fragment of a module, in words."""
    for sentence in sentences_of(path):
        for found in IDIOMS.finditer(sentence):
            yield f"{path.relative_to(ROOT)}: {found[0]!r}"
    for caption in captions_of(path.read_text(encoding="utf-8")):
        if FRAGMENT.match(caption):
            yield f"{path.relative_to(ROOT)}: the caption {caption[:40]!r}"


def test_an_idiom_and_a_fragment_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    module = tmp_path / "module.py"
    module.write_text(
        'A = 1\n"""So long it waits."""\n# somebody waits\nB = "plain words"\n', encoding="utf-8"
    )
    assert list(findings(module)) == ["module.py: 'somebody'", "module.py: the caption 'So long it waits.'"]


@pytest.mark.parametrize("package", PACKAGES)
def test_sentences_are_plain_english(package: str) -> None:
    paths = sorted((ROOT / package).rglob("*.py"))
    assert [each for path in paths for each in findings(path)] == []


DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
EXAMPLES = sorted(
    path
    for path in (ROOT / "examples").rglob("*")
    if path.suffix in {".java", ".lua", ".m", ".md", ".py", ".sh", ".yaml"}
)
QUOTED = re.compile(r"^(```|~~~).*?^\1[^\S\n]*$|`[^`\n]*`|\]\([^)\n]*\)", re.MULTILINE | re.DOTALL)
"""Code, messages and addresses in a document, which are not its prose."""
CEILINGS = {
    "CHANGELOG.md": 0,
    "benchmarks.md": 33,
    "contributing.md": 6,
    "learning.md": 2,
    "recording.md": 7,
    "ros2.md": 4,
    "signals-and-contact.md": 1,
    "streaming.md": 1,
    "your-gripper.md": 1,
}
"""Largest number of idioms in pages that were not edited yet; all other pages have none. Lower it after an
edit. contributing.md quotes the words that are not to be used."""
NAMED_SO = {"who may move the arm", "Nobody waits for a log", "who may use", "who may run"}
"""Names of sections, rows and folders, which other pages link to."""


def idioms_of(text: str) -> list[str]:
    """Banned idioms in the prose of a document or in the text of an example."""
    for name in NAMED_SO:
        text = re.sub(name, "", text, flags=re.IGNORECASE)
    return [found[0] for found in IDIOMS.finditer(text)]


def test_an_idiom_in_a_document_is_found_and_one_in_code_is_not() -> None:
    page = "Who wants more takes `whoever`.\n\n```\nanew\n```\nIt is told.\n\nWho does what?\n"
    assert idioms_of(QUOTED.sub("", page)) == ["Who wants", "is told"]


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: page.name)
def test_documents_are_plain_english(page: Path) -> None:
    found = idioms_of(QUOTED.sub("", page.read_text(encoding="utf-8")))
    assert len(found) <= CEILINGS.get(page.name, 0), found


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_examples_are_plain_english(path: Path) -> None:
    assert idioms_of(path.read_text(encoding="utf-8")) == []

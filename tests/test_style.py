"""Names and sentences of the code. Oracle: the rules of docs/contributing.md, "Names and sentences"."""

from __future__ import annotations

import ast
import re
import tokenize
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from functions import Function, functions_of

ROOT = Path(__file__).parents[1]
PACKAGES = ("cobot", "rtloop", "app", "packages")
IRREGULAR = {
    *("begun", "broken", "bought", "built", "caught", "chosen", "done", "drawn", "driven"),
    *("fallen", "felt", "forgotten", "found", "frozen", "given", "gone", "heard", "held", "hidden"),
    *("kept", "known", "led", "left", "lost", "made", "meant", "met", "said", "seen", "sent", "shown"),
    *("shot", "sold", "spent", "spoken", "struck", "stuck", "swept", "taken", "taught", "thrown"),
    *("told", "torn", "understood", "won", "worn", "wound", "written"),
}
STATES = {"alive", "due", "few", "free", "idle", "ready"}
"""Adjectives that have named functions which act."""
VERBS = {
    *("answer", "call", "check", "count", "differentiate", "find", "make", "move", "plan", "publish"),
    *("read", "refuse", "remove", "report", "require", "run", "solve", "stop", "take", "tell"),
    *("are", "await", "end", "has", "is", "on"),
}
"""First words of names that say what is done, whatever the last one is: `require_ready`, `is_gone`."""
REVIEWED = {
    *("connection_made", "connection_lost", "data_received", "wait_closed", "write_paused"),
    *("move_named", "plan_named", "ready", "kept_plan", "kept_plans", "recorded_path"),
    "done_s",
}
"""Names that others have given: methods of asyncio and uvicorn, and endpoints."""


IDIOMS = re.compile(
    r"\b(is said|says so|(is|are) told|goes by|held against|whoever|somebody|nobody|anybody|what is none|"
    r"anew|beside|at the (most|least)|as shipped|shall|for it is|of one piece|who (asks|has|is|may|wants))\b",
    re.IGNORECASE,
)
"""What style.md has a plain word for."""
FRAGMENT = re.compile(r"(So (long|many|far|much|often|near)|Of|The same|Likewise|And|As|Or|Without|Beyond) ")
"""A caption that begins so only finishes the sentence of the name above it."""
UNCLEAR = re.compile(r"Those (of|that|with) |One that |(The library's,|Ours:|Theirs:)")
"""A docstring that begins so does not name its subject."""


def is_participle(word: str) -> bool:
    return word in IRREGULAR | STATES or (word.endswith("ed") and not word.endswith(("eed", "embed")))


EXTREME = re.compile(
    r"^\s*(?:cdef \w+ |const )?_?((?:MOST|LEAST|LONGEST|SHORTEST|LARGEST|SMALLEST)(?:_\w+)?) *[:,=]", re.M
)
"""A constant that is a bound: its name begins with `MAX_` or `MIN_`."""


def is_misnamed(function: Function) -> bool:
    """Whether a function acts and is named by a participle or an adjective: an event or a flag."""
    words = function.name.strip("_").removeprefix("c_").split("_")
    if not function.acts or function.name in REVIEWED or words[0] in VERBS:
        return False
    return is_participle(words[-1]) or is_participle(words[0])


PYTHON = """
async def _started(): ...
async def measured_state(self): ...
def told(self) -> None: ...
@contextmanager
def watched(self): yield
def accepted(self, off):
    self.slop = off
    return off
def rotated(q): return q
def require_ready(self) -> None: ...
"""
CYTHON = """
cdef class Kept(Base):
    cdef void c_held(self) noexcept nogil:
        self.misread = False

    cdef bint c_lost(self) noexcept nogil:
        return self.misread

    def switched(self, power):
        self._power = power
cdef inline double filtered(double* first, double value) noexcept nogil:
    first[0] += value
    return first[0]
cdef double clamped(double value) noexcept nogil:
    return min(value, 1.0)
"""


@pytest.mark.parametrize(
    ("name", "source", "expected"),
    [
        ("a.py", PYTHON, ["_started", "measured_state", "told", "watched", "accepted"]),
        ("a.pyx", CYTHON, ["c_held", "switched", "filtered"]),
    ],
)
def test_a_misnamed_function_is_found(name: str, source: str, expected: list[str], tmp_path: Path) -> None:
    module = tmp_path / name
    module.write_text(source, encoding="utf-8")
    assert [each.name for each in functions_of(module) if is_misnamed(each)] == expected


@pytest.mark.parametrize("package", PACKAGES)
def test_functions_that_act_are_verbs(package: str) -> None:
    """`acknowledge`, not `acknowledged`: also in compiled modules."""
    wrong = [
        f"{path.relative_to(ROOT)}: {each.name}"
        for path in sources_of(package)
        for each in functions_of(path)
        if is_misnamed(each)
    ]
    assert wrong == []


@pytest.mark.parametrize("package", PACKAGES)
def test_bounds_are_called_max_and_min(package: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in sources_of(package, "py", "pyx", "pxd")
        for name in EXTREME.findall(path.read_text(encoding="utf-8"))
    ]
    assert wrong == []


def sources_of(package: str, *kinds: str) -> list[Path]:
    return sorted(path for kind in kinds or ("py", "pyx") for path in (ROOT / package).rglob(f"*.{kind}"))


def sentences_of(path: Path) -> Iterator[str]:
    """All comments and strings of a module. A line of Cython is one sentence: it has no other tokenizer."""
    if path.suffix in (".pyx", ".pxd"):
        yield from path.read_text(encoding="utf-8").splitlines()
        return
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


def docstrings_of(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def findings(path: Path) -> Iterator[str]:
    """Each idiom and each fragment of a module, in words."""
    for sentence in sentences_of(path):
        for found in IDIOMS.finditer(sentence):
            yield f"{path.relative_to(ROOT)}: {found[0]!r}"
    if path.suffix in (".pyx", ".pxd"):
        return
    for caption in captions_of(path.read_text(encoding="utf-8")):
        if FRAGMENT.match(caption):
            yield f"{path.relative_to(ROOT)}: the caption {caption[:40]!r}"
    for docstring in docstrings_of(path.read_text(encoding="utf-8")):
        if UNCLEAR.match(docstring):
            yield f"{path.relative_to(ROOT)}: the docstring {docstring[:40]!r}"


def test_an_idiom_and_a_fragment_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    module = tmp_path / "module.py"
    module.write_text(
        'A = 1\n"""So long it waits."""\n# somebody waits\nB = "plain words"\n', encoding="utf-8"
    )
    assert list(findings(module)) == ["module.py: 'somebody'", "module.py: the caption 'So long it waits.'"]
    module.write_text('def plans():\n    """Those of one robot."""\n', encoding="utf-8")
    assert list(findings(module)) == ["module.py: the docstring 'Those of one robot.'"]
    compiled = tmp_path / "module.pyx"
    compiled.write_text("cdef int count  # at the most ten\n", encoding="utf-8")
    assert list(findings(compiled)) == ["module.pyx: 'at the most'"]


@pytest.mark.parametrize("package", PACKAGES)
def test_sentences_are_plain_english(package: str) -> None:
    paths = sources_of(package, "py", "pyx", "pxd", "pyi")
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
    "contributing.md": 5,
}
"""Largest number of idioms in a page; others have none. contributing.md quotes the words to avoid."""
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

"""The documents against what they are about: links lead somewhere, and each list of theirs is whole.

Oracles: the files of the repository; the tables that the code itself goes by.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import yaml

from app.endpoint_table import table
from app.main import create_app
from app.routes import ENDPOINTS
from cobot.access.roles import Role
from cobot.addresses import VERSION
from cobot.client.connection import LONG_TIMEOUTS_S, MOTION_TIMEOUT_S
from cobot.config import Settings, load_settings
from cobot.ipc.layout import Intervention

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md"), *(ROOT / "tests").rglob("*.md")])
FENCE = re.compile(r"^(```|~~~).*?^\1[^\S\n]*$", re.M | re.S)


def prose(page: Path) -> str:
    """A page without its code, where nothing is a link."""
    return re.sub(r"`[^`\n]*`", "", FENCE.sub("", page.read_text(encoding="utf-8")))


@cache
def anchors(page: Path) -> frozenset[str]:
    """Of its headings, as the sites that show Markdown make them."""
    found: list[str] = []
    for heading in re.findall(r"^#{1,6} +(.+?) *#*$", FENCE.sub("", page.read_text(encoding="utf-8")), re.M):
        words = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
        name = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        again = found.count(name)
        found.append(name)
        if again:
            found.append(f"{name}-{again}")
    return frozenset(found)


def links(page: Path) -> Iterator[str]:
    """Those that lead to something in this repository."""
    for link in re.findall(r"\]\(([^)\s]+)(?: \"[^\"]*\")?\)", prose(page)):
        if not re.match(r"[a-z]+:", link):
            yield link


def dead(page: Path, link: str) -> bool:
    path, _, anchor = link.partition("#")
    target = (page.parent / path).resolve() if path else page
    return not target.exists() or (anchor != "" and anchor not in anchors(target))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_each_link_of_a_page_leads_somewhere(page: Path) -> None:
    assert [link for link in links(page) if dead(page, link)] == []


def test_the_check_of_links_finds_what_is_missing(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A `b`, c\n[x](page.md#a-b-c) [y](page.md#d) [z](gone.md) `[w](gone.md)`\n")
    assert [link for link in links(page) if dead(page, link)] == ["page.md#d", "gone.md"]


def test_each_page_can_be_reached_from_the_readme() -> None:
    found, open_pages = {ROOT / "README.md"}, [ROOT / "README.md"]
    while open_pages:
        page = open_pages.pop()
        for link in links(page):
            target = (page.parent / link.partition("#")[0]).resolve()
            if target.suffix == ".md" and target not in found:
                found.add(target)
                open_pages.append(target)
    assert [page.name for page in DOCS.rglob("*.md") if page not in found] == []


def test_the_page_of_endpoints_is_what_the_code_declares() -> None:
    """Mend it with `python -m app.endpoint_table`."""
    page = (DOCS / "endpoints.md").read_text(encoding="utf-8")
    assert page.partition("| Endpoint ")[1:] == (
        "| Endpoint ",
        "\n".join([*table(), ""]).removeprefix("| Endpoint "),
    )


def test_each_section_and_kind_is_explained_where_people_look() -> None:
    shipped = (ROOT / "config" / "cobot-setting.yaml").read_text(encoding="utf-8")
    assert [name for name in Settings.model_fields if f"\n{name}:" not in shipped and name != "robots"] == []
    state = (DOCS / "state-and-stop.md").read_text(encoding="utf-8")
    assert [kind.name for kind in Intervention if f"| `{kind.name.lower()}` |" not in state] == []


def test_the_pages_name_the_timeouts_of_the_client() -> None:
    page = (DOCS / "conventions.md").read_text(encoding="utf-8")
    motion_s, sequence_s = f"{MOTION_TIMEOUT_S:g} s", f"{LONG_TIMEOUTS_S['/robot/move/sequence']:g} s"
    assert f"{motion_s} for motions and trajectories (`sequence`: {sequence_s})" in page
    assert f"{LONG_TIMEOUTS_S['/recordings']:g} s for a recording's dump" in page
    motion = re.compile(r"--max-time (\d+)(?=[^\n]*/(?:move|execute|trajectory)/)")
    texts = [path.read_text(encoding="utf-8") for path in (*PAGES, ROOT / "examples" / "tour.sh")]
    found = [float(seconds) for text in texts for seconds in motion.findall(text)]
    assert len(found) > 5
    assert min(found) >= MOTION_TIMEOUT_S


def test_each_dependency_is_argued_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    groups = [project["project"]["dependencies"], *project["project"]["optional-dependencies"].values()]
    text = (DOCS / "dependencies.md").read_text(encoding="utf-8")
    table = set(re.findall(r"[\w-]+", " ".join(re.findall(r"^\| ([^|]+) \|", text, re.M))))
    words = set(re.findall(r"[\w-]+", text))
    names = [[re.split(r"[^\w-]", each)[0] for each in group] for group in groups]
    assert [name for name in names[0] if name not in table] == []
    said = {"pytest-timeout": "+timeout", "pytest-xdist": "+xdist", "tree-sitter-matlab": "MATLAB"}
    assert [n for group in names[1:] for n in group if n not in words and said.get(n, "?") not in text] == []


def test_the_roles_are_those_of_the_code_in_their_order() -> None:
    section = (DOCS / "security.md").read_text(encoding="utf-8").split("## Tokens and roles")[1]
    rows = re.findall(r"^\| ([a-z]+) \|", section.split("\n- ")[0], re.M)
    assert rows[: len(Role) - 1] == [role.name.lower() for role in Role if role is not Role.PUBLIC]


def test_on_the_site_each_link_leads_somewhere_and_each_page_is_in_the_navigation(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("make_site", DOCS / "make_site.py")
    assert spec is not None
    assert spec.loader is not None
    make_site = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_site)
    make_site.stage(tmp_path)
    pages = sorted(tmp_path.glob("*.md"))
    assert [(page.name, link) for page in pages for link in links(page) if dead(page, link)] == []
    navigation = tomllib.loads((DOCS / "zensical.toml").read_text(encoding="utf-8"))["project"]["nav"]
    listed = [name for part in navigation for names in part.values() for name in names]
    assert sorted(listed) == [page.name for page in pages]
    assert list((tmp_path / "files").rglob("*.md")) == [], "the site reads them as pages, so name them only"
    reference = (tmp_path / "reference-rest.md").read_text(encoding="utf-8")
    document = create_app(load_settings(), None, "http://robot.test").openapi()
    for name, model in document["components"]["schemas"].items():
        if not name.startswith(("Body_", "HTTPValidation", "ValidationError")):
            fields = [field for field in model.get("properties", {}) if f"\n| `{field}` | " not in reference]
            assert fields == [], name
    (tmp_path / "index.html").write_text(
        '<a href="gone.html">x</a><a href="#a">y</a><img src="https://a/b.png">'
    )
    assert len(list(make_site.problems(tmp_path))) == 3


def code(language: str) -> list[tuple[str, str]]:
    """(page, text) of each block in a language."""
    block = re.compile(rf"^```{language}\n(.*?)\n```$", re.M | re.S)
    return [(page.name, text) for page in PAGES for text in block.findall(page.read_text(encoding="utf-8"))]


def test_each_block_of_code_can_be_read() -> None:
    assert min(len(code(language)) for language in ("python", "yaml", "json")) > 5
    for read, language in ((ast.parse, "python"), (yaml.safe_load, "yaml")):
        for page, text in code(language):
            try:
                read(text)
            except (SyntaxError, yaml.YAMLError) as exc:
                pytest.fail(f"{page}: {exc}\n{text}")
    for page, text in code("json"):
        if "..." not in text:
            place, read_json = 0, json.JSONDecoder().raw_decode
            while place < len(text):
                try:
                    _, place = read_json(text, place)
                except ValueError as exc:
                    pytest.fail(f"{page}: {exc}\n{text}")
                place += len(text[place:]) - len(text[place:].lstrip())


def test_each_address_that_people_are_told_to_ask_is_one() -> None:
    known = {name.split(" ")[1] for name in ENDPOINTS} | {
        *("/mcp/mcp", "/docs", "/docs/samples/{name}", "/openapi", "/manual"),
        "/",
    }
    known |= {re.sub("^/robot(?=/)", "", path) for path in known}
    known = {re.escape(path).replace(r"\{Class\}", "[A-Z]\\w+") for path in known}
    patterns = [re.compile(re.sub(r"\\{\w+\\}", "[^/]+", path) + "$") for path in known]
    asked, wrong = 0, []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for path in re.findall(r"(?:COBOT_URL\"?|localhost:8007)(/[\w/-]*)", text):
            asked += 1
            plain = re.sub(r"^/robots/\w+(?=/)", "", path.removeprefix(VERSION))
            if not any(pattern.match(plain) for pattern in patterns):
                wrong.append((page.name, path))
    assert asked > 30
    assert wrong == []


def test_the_house_has_every_room() -> None:
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    (house,) = re.findall(r"^```\n(cobot/ .*?)^```", page, re.M | re.S)
    packages = ("cobot", "rtloop", "app")
    rooms = [
        file.parent.relative_to(ROOT) for name in packages for file in (ROOT / name).rglob("__init__.py")
    ]
    assert len(rooms) > 50
    names = set(re.findall(r"\w+", house))
    assert [str(room) for room in rooms if not names.issuperset(room.parts)] == []

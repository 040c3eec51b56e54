"""What is served for the panel, without a browser; tests/e2e/test_panel.py has one."""

from __future__ import annotations

import asyncio
import json
import re
from importlib.resources import files
from pathlib import Path
from typing import get_args

import httpx
import pytest
from fastapi import FastAPI

from app.api.errors import OF_HTTP
from app.main import create_app
from app.panel import pages
from app.services.events.ring import TYPES
from app.services.rights.job import JobKind
from app.services.rights.stop_reason import StopCause
from cobot.access.roles import RoleName
from cobot.access.tokens import MAX_DAYS, NAME
from cobot.config import Settings
from cobot.errors import BY_CODE
from cobot.findings import Check, Kind
from cobot.ipc.state_fields import MEASURED_NAMES
from cobot.motions.planners import GOAL_ALONE, PLANNERS
from cobot.reasons import ReasonCode
from cobot.robot.device import FLAGS
from cobot.trajectory import NoticeKind

REPOSITORY = Path(__file__).parents[3]
SCRIPTS = sorted(pages.SITE.glob("*.js"))
LANGUAGES = ("en", "de", "zh")
MADE = ("gripper_", "shape_", "mode_", "way_", "able_", "measured_", "event_", "said_")
MADE += ("change_", "check_", "conflict_", "error_", "notice_", "reason_", "says_")
MADE += ("kind_", "part_", "role_", "say_", "step_", "study_", "test_")
"""So begin names of words that are put together."""


@pytest.fixture(scope="module")
def app(settings: Settings) -> FastAPI:
    return create_app(settings, None, "http://robot.test")


def ask(app: FastAPI, path: str) -> httpx.Response:
    async def asking() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://robot.test") as client:
            return await client.get(path)

    return asyncio.run(asking())


def used(pattern: str) -> set[str]:
    """What the page and its scripts name."""
    texts = [file.read_text(encoding="utf-8") for file in [*SCRIPTS, pages.SITE / "index.html"]]
    return {found for text in texts for found in re.findall(pattern, text)}


def test_the_page_and_all_that_it_names_come_from_here_with_a_strict_policy(app: FastAPI) -> None:
    page = ask(app, "/")
    assert page.headers["content-type"].startswith("text/html")
    named = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    assert not [each for each in named if each.startswith("/")], "a hub has the panel below another path"
    addresses = {"/", *(f"/{each}" for each in named)} - {"/docs"}
    addresses |= {f"/panel/{file.name}" for file in pages.SITE.iterdir()}
    for address in addresses:
        if address.startswith("/manual/"):
            continue  # the manual has a policy of its own: tests/app/panel/test_manual.py
        answer = ask(app, address)
        assert answer.status_code == 200, address
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "script-src 'self';" in policy
        assert "unsafe" not in policy
        assert answer.headers["x-frame-options"] == "DENY"
        assert "//" not in re.sub(r"(?m)^\s*//.*$|http://www\.w3\.org", "", answer.text).replace(" // ", "")
    assert not re.findall(r"<script(?![^>]*src)|<style|\bon\w+=|style=", page.text), "nothing is inline"


def test_three_js_is_served_as_the_package_has_it(app: FastAPI) -> None:
    vendor = files("ifc_console_viewer") / "static" / "vendor"
    for name in pages.THREE_MODULES:
        answer = ask(app, f"/three/{name}")
        assert answer.content == (vendor / name).read_bytes()
        assert answer.headers["content-type"].startswith("text/javascript")
        assert "script-src 'self';" in answer.headers["content-security-policy"]


def test_each_module_that_the_panel_or_three_js_imports_is_served(app: FastAPI) -> None:
    """Oracle: the import statements of the panel's scripts and of the modules themselves."""
    modules = used(r"from \"\.\.(/three/[^\"]+)\"")
    assert modules
    texts = {name: ask(app, f"/three/{name}").text for name in pages.THREE_MODULES}
    for text in texts.values():
        modules |= {f"/three/{name}" for name in re.findall(r"from ?['\"]\./([^'\"]+)['\"];", text)}
    assert modules == {f"/three/{name}" for name in pages.THREE_MODULES}
    exported = (
        texts["three.module.min.js"].rsplit("export{", 1)[1]
        + texts["three.core.min.js"].rsplit("export{", 1)[1]
    )
    for name in used(r"\bTHREE\.(\w+)"):
        assert re.search(rf"\b{name}\b", exported), name


def test_the_panel_has_the_planners_of_the_service(app: FastAPI) -> None:
    """Oracle: docs/planning.md, by which lin alone of these ends at a pose, and each takes a goal alone."""
    answer = ask(app, "/panel/planners.js")
    assert answer.headers["content-type"].startswith("text/javascript")
    assert "script-src 'self';" in answer.headers["content-security-policy"]
    declared = re.findall(r"^export const (\w+) = (.*);$", answer.text, re.M)
    found = {name: json.loads(value) for name, value in declared}
    assert set(found) == {"PLANNERS", "DEFAULT"}
    assert found["DEFAULT"] == "ptp"
    assert set(found["PLANNERS"]) == set(GOAL_ALONE)
    need_a_pose = {"ptp": False, "auto": False, "ompl": False, "chomp": False, "lin": True}
    assert {name: found["PLANNERS"][name]["pose"] for name in need_a_pose} == need_a_pose
    scripts = "".join(file.read_text(encoding="utf-8") for file in SCRIPTS if "step" in file.name)
    assert not [name for name in PLANNERS if f'"{name}"' in scripts]


def test_without_the_package_of_three_js_the_answer_names_it(
    app: FastAPI, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pages, "find_spec", lambda name: None)
    answer = ask(app, "/three/OrbitControls.js")
    assert answer.status_code == 404
    assert "ifc-console-viewer" in answer.json()["detail"]


def test_the_address_that_people_guess_leads_to_the_panel(app: FastAPI) -> None:
    """Oracle: a person who typed /panel saw an error, because only the panel's files were below it."""
    for path in ("/panel", "/panel/"):
        answer = ask(app, path)
        assert (answer.status_code, answer.headers["location"]) == (307, "/"), path
        assert ask(app, f"/v1{path}").headers["location"] == "/", path


def test_nothing_else_is_served(app: FastAPI) -> None:
    for path in (
        "/panel/../pages.py",
        "/panel/%2e%2e/pages.py",
        "/panel/none.js",
        "/three/web-ifc-api.js",
    ):
        assert ask(app, path).status_code == 404, path


def test_each_word_is_there_in_each_language() -> None:
    catalogue = json.loads((pages.SITE / "words.json").read_text(encoding="utf-8"))
    assert set(catalogue) == set(LANGUAGES)
    names = {language: set(words) for language, words in catalogue.items()}
    assert names["en"] == names["de"] == names["zh"]
    holes = {
        language: {name: sorted(re.findall(r"\{(\w+)\}", text)) for name, text in words.items()}
        for language, words in catalogue.items()
    }
    assert holes["en"] == holes["de"] == holes["zh"], "the same values stand in each"
    asked = used(r'\bword\("(\w+)"') | used(r'data-word(?:-label)?="(\w+)"')
    assert asked <= names["en"], asked - names["en"]
    spoken = asked | used(r'"(\w+)"') | {name for name in names["en"] if name.startswith(MADE)}
    assert names["en"] <= spoken, names["en"] - spoken


def test_each_code_of_a_reason_has_words_and_is_documented() -> None:
    """Oracle: the enumeration, and the table in docs/conventions.md."""
    codes = {*ReasonCode} - {ReasonCode.OTHER}
    assert words_of("reason_") == codes | {*get_args(StopCause)} - {"stop"}
    manual = (REPOSITORY / "docs" / "conventions.md").read_text(encoding="utf-8").partition("### Reasons")[2]
    rows = manual.partition("| Codes |")[2].partition("\n\n")[0]
    assert {*re.findall(r"`(\w+)`", rows)} == codes


def test_no_sentence_of_the_service_is_taken_apart() -> None:
    """Oracle: what the panel shows of a reason comes from its code, never from a pattern over its words."""
    for name in ("banner", "reasons", "halt", "log", "jog", "lease"):
        script = (pages.SITE / f"{name}.js").read_text(encoding="utf-8")
        assert not re.search(r"\.(?:test|match|exec)\(|RegExp", script), name


def test_each_exported_name_is_used_elsewhere() -> None:
    """Oracle: the imports of the other modules, and of the tests."""
    scripts = {file.name: file.read_text(encoding="utf-8") for file in pages.SITE.glob("*.js")}
    imports = r"(?s)(?:import|const) \{([^}]*)\} (?:from|= await import\() ?\"\./%s\""
    tested = "".join(file.read_text(encoding="utf-8") for file in (REPOSITORY / "tests").rglob("*.py"))
    for name, script in scripts.items():
        found = re.findall(imports % re.escape(name), "\n".join(scripts.values()))
        used = {each.split(" as ")[0].strip() for names in found for each in names.split(",")}
        if f"/panel/{name}" in tested:
            used |= {*re.findall(r"\w+", tested)}
        exported = {*re.findall(r"(?m)^export (?:async )?(?:function|const|class|let) (\w+)", script)}
        assert exported <= used, (name, exported - used)


def words_of(begin: str) -> set[str]:
    """The rest of each word's name that begins so."""
    words = json.loads((pages.SITE / "words.json").read_text(encoding="utf-8"))["en"]
    return {name.removeprefix(begin) for name in words if name.startswith(begin)}


def test_each_cause_in_the_details_of_an_error_has_words_and_is_documented() -> None:
    """Oracle: the tables of causes in docs/conventions.md, and the errors that the service makes."""
    manual = (REPOSITORY / "docs" / "conventions.md").read_text(encoding="utf-8").partition("### Details")[2]
    documented = {}
    for code in ("stopped", "conflict"):
        table = manual.partition(f"| `cause` of `{code}` |")[2].partition("\n\n")[0]
        documented[code] = {
            cause for cell in re.findall(r"(?m)^\|([^|]*)\|", table) for cause in re.findall(r"`(\w+)`", cell)
        }
    assert documented["stopped"] == {*get_args(StopCause)}
    assert documented["conflict"] == words_of("conflict_")
    files = [file for folder in ("app", "cobot") for file in (REPOSITORY / folder).rglob("*.py")]
    sources = "".join(file.read_text(encoding="utf-8") for file in files)
    made = set(re.findall(r'details=\{"cause": "(\w+)"', sources))
    assert made | {"scene_changed", "tool_changed"} == documented["conflict"]


NOT_MET = {
    "header": "the panel sends no such header",
    "http": "the panel sends valid HTTP",
    "layout": "processes of two versions, which do not start together",
    "media_type": "the panel sends the right Content-Type",
    "method_not_allowed": "the panel uses the right methods",
    "misdirected": "a wrong host name, for which the page itself is not served either",
}
"""Codes that no user of the panel meets, with the reason."""


def test_each_code_of_an_error_has_words_unless_no_user_of_the_panel_meets_it() -> None:
    """Oracle: the tree of errors. Each word has three languages (see above)."""
    whole, introduced = words_of("error_"), words_of("says_")
    assert not whole & introduced
    assert whole | introduced | {*NOT_MET} == {*BY_CODE, *OF_HTTP}
    assert not {*NOT_MET} & (whole | introduced)
    catalogue = json.loads((pages.SITE / "words.json").read_text(encoding="utf-8"))
    for language, words in catalogue.items():
        texts = [words[f"says_{code}"] for code in sorted(introduced)]
        assert all(text.endswith("{says}") for text in texts), "the sentence has the field and the value"
        assert len({*texts}) == (1 if language == "en" else len(texts)), "it is English itself"


def test_each_word_for_a_check_or_a_notice_belongs_to_one() -> None:
    assert words_of("change_") == {*get_args(Kind)}
    checks = {*get_args(Check)}
    assert checks <= words_of("check_")
    assert {name.partition("_")[0] for name in words_of("check_")} - {"at"} == checks
    assert words_of("kind_") == {*JobKind}
    notices = {*get_args(NoticeKind)} - {"auto"}
    assert notices <= words_of("notice_")
    assert words_of("notice_") - notices - {"other"} <= {*PLANNERS}, "the planner that auto has used"


def test_the_form_for_tokens_has_the_roles_and_limits_of_the_service() -> None:
    page = (pages.SITE / "index.html").read_text(encoding="utf-8")
    options = page.partition('<select id="people-role">')[2].partition("</select>")[0]
    assert re.findall(r'<option value="(\w+)" data-word="role_may_(\w+)"', options) == [
        (role, role) for role in get_args(RoleName)
    ]
    assert words_of("role_") == {name for role in get_args(RoleName) for name in (role, f"may_{role}")}
    script = (pages.SITE / "people.js").read_text(encoding="utf-8")
    assert f"const NAME = /{NAME}/;" in script
    assert f"const MAX_DAYS = {MAX_DAYS:_};" in script
    for words in json.loads((pages.SITE / "words.json").read_text(encoding="utf-8")).values():
        assert str(MAX_DAYS) in words["token_days_wrong"]


def test_each_ability_and_measurement_has_a_word() -> None:
    words = json.loads((pages.SITE / "words.json").read_text(encoding="utf-8"))["en"]
    assert {f"able_{name}" for name in FLAGS} == {name for name in words if name.startswith("able_")}
    measured = {f"measured_{name}" for name in MEASURED_NAMES}
    assert measured == {name for name in words if name.startswith("measured_")}


def test_each_type_of_event_has_a_word() -> None:
    words = json.loads((pages.SITE / "words.json").read_text(encoding="utf-8"))["en"]
    assert {f"event_{name}" for name in (*TYPES, "lost")} == {
        name for name in words if name.startswith("event_")
    }


def test_each_type_of_event_has_a_sentence() -> None:
    """Oracle: docs/events.md, which has what each type says in `what`."""
    words = json.loads((pages.SITE / "words.json").read_text(encoding="utf-8"))["en"]
    manual = (REPOSITORY / "docs" / "events.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"(?m)^\| `(\w+)` \| (.*) \|$", manual))
    for kind in TYPES:
        told = re.sub(r"\([^)]*\)", "", rows[kind].partition("`what`:")[2]).partition(";")[0]
        for what in re.findall(r"`([\w ]+)`", told) or [""]:
            assert {f"said_{kind}_{what}", f"said_{kind}"} & set(words), (kind, what)


def test_the_stop_needs_no_other_script() -> None:
    script = (pages.SITE / "stop.js").read_text(encoding="utf-8")
    assert "import" not in script
    page = (pages.SITE / "index.html").read_text(encoding="utf-8")
    assert re.findall(r'<script[^>]*src="([^"]+)"', page) == ["panel/stop.js", "panel/main.js"]
    calls = " ".join(re.findall(r"\bfail\((?:press|detail\.number), .*", script))
    reasons = set(re.findall(r'"(\w+)"', calls)) - {"TimeoutError"}
    assert dict(re.findall(r'data-why="(\w+)" data-word="(\w+)"', page)) == {
        each: f"stop_{each}" for each in reasons
    }


def test_modules_stay_small() -> None:
    assert SCRIPTS
    for file in SCRIPTS:
        assert len(file.read_text(encoding="utf-8").splitlines()) < 300, file.name

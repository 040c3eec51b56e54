"""The operator panel in a headless Chromium, as a person uses it; the arm's reaction is asked of REST.

The tests are in tests/support/panel, by what they show. They are one file for pytest, which starts one
browser and one service for all of them and can tell in the end which controls nobody has used.

With COBOT_PICTURES=FOLDER they write the documents' pictures of the panel there, one of them moving.
"""

from __future__ import annotations

import ast
import hashlib
from collections import Counter
from pathlib import Path

import pytest
from panel.dragging import *  # noqa: F403
from panel.files import *  # noqa: F403
from panel.jogging import *  # noqa: F403
from panel.looking import *  # noqa: F403
from panel.moving import *  # noqa: F403
from panel.page import *  # noqa: F403
from panel.page import ELSEWHERE, OPERATED, SEEN, Panel
from panel.programming import *  # noqa: F403
from panel.reading import *  # noqa: F403
from panel.setting_up import *  # noqa: F403
from panel.standing import *  # noqa: F403
from panel.stopping import *  # noqa: F403
from panel.storing import *  # noqa: F403
from panel.studying import *  # noqa: F403
from panel.teaching import *  # noqa: F403
from panel.watching import *  # noqa: F403

from app.panel import pages

pytestmark = pytest.mark.thorough

USED = "cobot/panel"
PARTS = sorted(Path(__file__).parents[1].joinpath("support/panel").glob("*.py"))


def test_no_file_of_these_tests_hides_a_test_or_a_fixture_of_another() -> None:
    names = [
        node.name
        for file in PARTS
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef)
    ]
    assert sorted(name for name, times in Counter(names).items() if times > 1) == []


def test_each_control_was_pressed_or_changed_by_these_tests(
    panel: Panel, request: pytest.FixtureRequest
) -> None:
    """Not by a script: see `panel.page.CONTROLS`. What has failed runs again alone: so what was used before,
    by the same tests on the same page, counts too.
    """
    panel.page.run("document.querySelectorAll('details.card').forEach((each) => (each.open = true))")
    panel.page.run("lookForControls()")
    cache = getattr(request.config, "cache", None)
    of = digest()
    kept = cache.get(USED, {}) if cache else {}
    used = OPERATED | set(kept.get(of, ()))
    if cache:
        cache.set(USED, {of: sorted(used)})
    assert len(SEEN) > 60
    assert sorted(SEEN - used - ELSEWHERE) == []


def digest() -> str:
    """Of the page and its tests."""
    files = [*pages.SITE.iterdir(), *PARTS]
    return hashlib.sha256(b"".join(file.read_bytes() for file in sorted(files))).hexdigest()

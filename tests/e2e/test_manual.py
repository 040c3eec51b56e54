"""The manual at /manual in a headless Chromium: its own search answers what people ask first."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import httpx
import pytest
import uvicorn
from chromium import CHROMIUM, Page, browsing
from cobot_run import until
from thorough import few

from app.main import create_app
from app.panel import manual, pages
from cobot.config import Settings

QUESTIONS = {
    "is this a simulation?": "questions.html#is-this-a-simulation",
    "open the gripper": "questions.html#how-do-i-open-the-gripper",
    "log in": "questions.html#how-do-i-log-in",
    "PLC": "services.html#connect-a-plc-over-modbus-tcp",
    "change the port": "questions.html#how-do-i-change-the-port",
    "robot does not move": "questions.html#why-does-the-robot-not-move",
    "why did the robot stop": "questions.html#why-did-the-robot-stop",
    "robot does not answer": "questions.html#why-does-the-robot-not-move",
    "reset takes long": "questions.html#why-does-a-reset-take-long",
    "make the motion faster": "questions.html#how-do-i-make-the-motion-faster",
    "why is the robot slow?": "questions.html#why-is-the-robot-slow",
    "point cloud": "scene.html#large-point-clouds",
    "change the speed": "change-the-speed.html",
    "teach a position": "questions.html#how-do-i-teach-a-position",
    "set tool weight": "questions.html#how-do-i-set-the-tool-and-its-weight",
    "record a trajectory": "questions.html#how-do-i-record-a-trajectory",
    "windows": "windows-csharp-labview-node-red.html#python-on-windows",
    "backup": "operations.html#backup",
    "How do I open the gripper?": "questions.html#how-do-i-open-the-gripper",
    "how can I change the speed?": "change-the-speed.html",
    "How do I make a motion faster?": "questions.html#how-do-i-make-the-motion-faster",
    "why does the reset take so long?": "questions.html#why-does-a-reset-take-long",
    "why does my robot not move?": "questions.html#why-does-the-robot-not-move",
    "What should I do to set the weight of my tool?": "questions.html#how-do-i-set-the-tool-and-its-weight",
}
"""What is typed, and the place that the first result leads to."""
WATCH = """
window.problems = [];
addEventListener("error", (event) => problems.push(event.message));
document.addEventListener("securitypolicyviolation", (event) => problems.push(event.violatedDirective));
"""
FIRST_RESULT = "document.activeElement?.shadowRoot?.querySelector('a')?.getAttribute('href') ?? ''"
"""The search box and its results are in a shadow root of the element that has the focus."""

pytestmark = pytest.mark.skipif(
    not (manual.SITE / "index.html").is_file(), reason="the manual is not built: make docs"
)


@pytest.fixture(scope="module")
def url(settings: Settings) -> Iterator[str]:
    """The address of the service's pages, without a robot behind them."""
    app = create_app(settings, None, "http://127.0.0.1")
    server = uvicorn.Server(uvicorn.Config(app, port=0, lifespan="off", log_level="warning"))
    thread = threading.Thread(target=server.run)
    thread.start()
    until(lambda: server.started, lambda: "the server does not start")
    yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    server.should_exit = True
    thread.join()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    if CHROMIUM is None:
        pytest.skip("needs a browser: apt-get install chromium")
    with browsing(tmp_path_factory.mktemp("chromium")) as tools:
        opened = Page(tools)
        opened.ask("Page.enable")
        opened.ask("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
        yield opened


@pytest.mark.parametrize("question", few(QUESTIONS, 4))
def test_the_first_result_of_the_search_is_the_right_page(page: Page, url: str, question: str) -> None:
    page.visit(f"{url}/manual/")
    page.run("document.querySelector('.md-search__button').click()")
    until(lambda: page.run("!!document.activeElement?.shadowRoot"), lambda: "no search box has the focus")
    page.ask("Input.insertText", text=question)
    until(lambda: page.run(FIRST_RESULT), lambda: f"no result for {question!r}")
    found = httpx.URL(page.run(FIRST_RESULT))
    place = f"{found.path.removeprefix('/manual/')}#{found.fragment}"
    assert place.removesuffix("#") == QUESTIONS[question]
    assert page.run("problems") == []


def test_each_page_of_the_panel_has_its_chapter(url: str) -> None:
    chapters = httpx.get(f"{url}/manual/panel.html").text
    for name in ("move", "program", "run", "diagnose", "setup"):
        assert f'data-page="{name}"' in (pages.SITE / "index.html").read_text(encoding="utf-8")
        assert f'id="{name}"' in chapters


@pytest.mark.parametrize(
    "path",
    ["../pages.py", "%2e%2e/pages.py", "..%2f..%2fmain.py", "%2fetc%2fpasswd", "assets", "no-such-page.html"],
)
def test_nothing_but_the_pages_of_the_manual_is_served(url: str, path: str) -> None:
    host = httpx.URL(url)
    with httpx.Client() as client:  # the path as it is written, which httpx would tidy up
        request = client.build_request("GET", host.copy_with(raw_path=f"/manual/{path}".encode()))
        answer = client.send(request)
    assert answer.status_code == 404
    assert "import" not in answer.text
    assert "root:" not in answer.text


def test_the_pages_may_be_kept_and_are_asked_for_again(url: str) -> None:
    answer = httpx.get(f"{url}/manual/index.html")
    again = httpx.get(f"{url}/manual/index.html", headers={"If-None-Match": answer.headers["etag"]})
    assert (answer.status_code, again.status_code) == (200, 304)
    assert "unsafe" not in answer.headers["content-security-policy"].partition("style-src")[0]
    assert httpx.get(f"{url}/manual").headers["location"].endswith("/manual/")

"""Programs that the panel stores at the service, and two people who change one of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from cobot_run import WAIT_S, until

from panel.page import HOME, Panel, forget, set_to
from panel.teaching import STEPS

LABEL = "Über <b>Kiste</b> 取料点"
THEIRS = {"label": LABEL, "text": json.dumps({"waypoints": [{"joints": HOME, "label": "theirs"}]})}


@pytest.fixture
def store(panel: Panel) -> Iterator[httpx.Client]:
    """The service over REST; what the test has stored there is deleted."""
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as client:
        panel.page.run("localStorage.clear()")
        panel.load()
        panel.page.click("#tab-program")
        yield client
        for each in client.get("/programs").json():
            client.delete(f"/programs/{each['id']}")
        panel.page.run("localStorage.clear()")
        panel.load()


def said(panel: Panel, text: str, where: str = "program-why") -> None:
    panel.until(f"document.querySelector('#{where}').innerText.includes({json.dumps(text)})")


def stored(store: httpx.Client, label: str = LABEL) -> dict[str, Any]:
    return next(each for each in store.get("/programs").json() if each["label"] == label)


def saved(panel: Panel, version: int = 1) -> None:
    panel.page.click("#program-save")
    said(panel, f"is saved as version {version}")


def test_a_program_is_stored_opened_and_not_written_over(panel: Panel, store: httpx.Client) -> None:
    """Oracle: what the service has, read over REST; the steps in the page."""
    panel.page.click("#teach")
    panel.page.click("#program-save")
    said(panel, "Enter a name first")
    panel.page.write("#program-name", LABEL)
    saved(panel)
    first = stored(store)
    assert first["version"] == 1
    assert len(json.loads(store.get(f"/programs/{first['id']}").json()["text"])["steps"]) == 1
    panel.until("document.querySelector('#program-save').disabled")

    panel.page.click("#teach")
    store.put(f"/programs/{first['id']}", json=THEIRS, headers={"If-Match": '"1"', "X-Client-Name": "Anna"})
    said(panel, "Anna", "stored-why")
    panel.page.click("#program-save")
    said(panel, "Not saved, but kept in this browser")
    said(panel, "Anna", "stored-why")
    forget(panel, "412")
    assert len(panel.page.run(f"{STEPS}.steps")) == 2, "nothing is lost"
    panel.page.click("#stored-other")
    said(panel, "is saved as version 1")
    labels = {each["label"]: each for each in store.get("/programs").json()}
    assert set(labels) == {LABEL, f"{LABEL} (2)"}
    assert labels[LABEL]["version"] == 2, "theirs is as it was"

    panel.until("document.querySelector('#stored').options.length === 2")
    for each in (labels[f"{LABEL} (2)"], first):
        set_to(panel, "#stored", each["id"])
    panel.until("document.querySelector('#stored-version').options.length === 2")
    set_to(panel, "#stored-version", "1")
    panel.page.click("#stored-open")
    said(panel, "is open, version 1")
    store.put(f"/programs/{first['id']}", json=THEIRS | {"note": "again"}, headers={"If-Match": '"2"'})
    said(panel, "version 3", "stored-why")
    panel.page.click("#stored-theirs")
    said(panel, "is open, version 3")
    assert panel.page.run(f"{STEPS}.waypoints[0].label") == "theirs"
    store.put(f"/programs/{first['id']}", json=THEIRS | {"note": "and again"}, headers={"If-Match": '"3"'})
    said(panel, "is open, version 4")  # nothing was changed here, so it is shown
    panel.page.click("#stored-copy")
    said(panel, "is saved as version 1")
    panel.until("cobotPanel.stored.list.length === 3")
    set_to(panel, "#stored", first["id"])
    panel.page.click("#stored-delete")
    said(panel, "is deleted")
    until(lambda: len(store.get("/programs").json()) == 2)


def test_a_program_that_another_deletes_stays_in_the_browser(panel: Panel, store: httpx.Client) -> None:
    panel.page.click("#teach")
    panel.page.write("#program-name", LABEL)
    saved(panel)
    store.delete(f"/programs/{stored(store)['id']}")
    said(panel, "has deleted this program", "stored-why")
    assert panel.page.run("document.querySelector('#stored-theirs').hidden")
    panel.page.click("#stored-other")
    said(panel, "is saved as version 1")
    assert len(store.get("/programs").json()) == 1


def test_a_save_that_fails_loses_nothing_and_can_be_repeated(panel: Panel, store: httpx.Client) -> None:
    """A service that cannot write, as on a full disk, and one that does not answer."""
    panel.page.click("#teach")
    panel.page.write("#program-name", LABEL)
    saved(panel)
    folder = next(panel.run.config.parent.rglob("*.programs"))
    aside = folder.with_name("aside")
    folder.rename(aside)
    folder.write_text("in the way")
    try:
        panel.page.click("#teach")
        panel.page.click("#stored-copy")
        said(panel, "Not saved, but kept in this browser")
        said(panel, "Not a directory")
    finally:
        folder.unlink()
        aside.rename(folder)
    forget(panel, "503", "412")
    panel.load()
    panel.page.click("#tab-program")
    assert len(panel.page.run(f"{STEPS}.steps")) == 2
    panel.page.block("*/programs/*")
    panel.page.click("#program-save")
    said(panel, "is not answered")
    panel.page.block()
    forget(panel, "ERR_BLOCKED")
    saved(panel)
    assert len(store.get("/programs").json()) == 2


def test_a_lua_program_is_stored_and_opened_as_text(panel: Panel, store: httpx.Client) -> None:
    panel.page.click("#program-lua")
    set_to(panel, "#program-text", "print('one')")
    panel.page.write("#program-name", "lua of mine")
    saved(panel)
    assert (stored(store, "lua of mine")["kind"], stored(store, "lua of mine")["version"]) == ("lua", 1)
    panel.page.click("#program-new")
    panel.until("document.querySelector('#steps').checkVisibility()")
    set_to(panel, "#stored", stored(store, "lua of mine")["id"])
    panel.page.click("#stored-open")
    panel.until("document.querySelector('#program-text').value === \"print('one')\"")
    assert panel.page.run("document.querySelector('#program-text').checkVisibility()")

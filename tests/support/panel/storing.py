"""Programs that the panel stores at the service, and two people who change one of them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from cobot_run import WAIT_S, until

from panel.page import HOME, Panel, forget, is_at, set_to
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
    until(lambda: len(store.get("/programs").json()) == 1)
    said(panel, "is saved as version 1")


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


def test_a_stored_program_is_run_with_its_step_cycles_and_a_pause(panel: Panel, http: httpx.Client) -> None:
    """Oracle: the status of the sequence over REST, and where the arm is."""
    places = [[0.1, *HOME[1:]], [0.0, 0.1, *HOME[2:]]]
    steps = [{"joints": each, "speed": 0.5, "label": "<i>there</i>"} for each in places]
    body = {"label": LABEL, "text": json.dumps({"steps": [*steps, {"wait_s": 0.1}]})}
    http.put("/programs/kiste", json=body).raise_for_status()
    http.put("/programs/other", json={"label": "other", "kind": "lua", "text": "print(1)"}).raise_for_status()
    panel.page.click("#tab-run")
    panel.until("document.querySelectorAll('#run-list li').length === 2")
    assert LABEL in panel.text("#run-list"), "markup is text"
    assert panel.page.run("document.querySelector('#run-pause-at').disabled"), "no program is running"
    panel.page.click("#run-list [data-run=other]")
    assert panel.page.run("document.querySelector('#run-from').disabled"), "it has no numbered steps"
    assert panel.page.run("document.activeElement.dataset.run") == "other"
    panel.page.click("#run-list [data-run=kiste]")
    set_to(panel, "#points-rounds", "3")
    panel.page.click("#points-run")
    said(panel, "The program has ended.", "run-why")
    assert http.get("/sequences/status").json()["iteration"] == 3
    assert is_at(panel, places[-1])
    panel.until("cobotPanel.runNow.newest.cycles.length === 3")
    assert panel.text("#run-cycle") == "3 of 3"
    assert panel.text("#run-program") == LABEL
    cycles = panel.page.run("cobotPanel.runNow.newest.cycles")
    assert all(0.1 < each < 60 for each in cycles)
    last, mean = re.findall(r"[\d.]+", panel.text("#run-time"))  # JavaScript rounds 1.25 up, Python to even
    assert (float(last), float(mean)) == pytest.approx((cycles[-1], sum(cycles) / 3), abs=0.0501)

    set_to(panel, "#run-from", "2")
    set_to(panel, "#points-rounds", "1")
    panel.page.click("#points-step")
    panel.until("document.querySelector('#pause').innerText === 'Resume'")
    panel.page.click("#run-pause-at")
    assert panel.page.run("document.activeElement.id") == "run-at", "a number is missing"
    set_to(panel, "#run-at", "9")
    panel.page.click("#run-pause-at")
    said(panel, "there are 3 waypoints, numbered from 1; got 9", "run-now-why")
    forget(panel, "422")
    set_to(panel, "#run-at", "2")
    panel.page.click("#run-pause-at")
    said(panel, "pauses once step 2 is done", "run-now-why")
    panel.page.click("#end")
    said(panel, "Ended by an unnamed client", "run-why")
    panel.load()
    panel.page.click("#tab-run")
    said(panel, LABEL, "run-program")


def test_a_program_that_pauses_after_a_step_goes_on_from_there(panel: Panel, http: httpx.Client) -> None:
    """Oracle: where the arm is; another client has started the program."""
    places = [[0.1, *HOME[1:]], [0.0, 0.1, *HOME[2:]]]
    steps = [{"joints": each, "speed": 0.5} for each in places]
    http.put("/programs/two", json={"label": "two", "text": json.dumps({"steps": steps})}).raise_for_status()
    http.post("/programs/two/run", json={"hold": True}).raise_for_status()
    panel.page.click("#tab-run")
    said(panel, "two", "run-program")
    panel.until("document.querySelector('#pause').innerText === 'Resume'")
    set_to(panel, "#run-at", "1")
    panel.page.click("#run-pause-at")
    panel.page.click("#pause")
    until(lambda: is_at(panel, places[0]))
    panel.until("document.querySelector('#pause').innerText === 'Resume'")
    panel.stays()
    panel.page.click("#pause")
    until(lambda: is_at(panel, places[1]))
    panel.until("!cobotPanel.runNow.newest.runs")
    panel.until("document.querySelector('#run-pause-at').disabled")

"""Programs that the panel stores at the service, and two people who change one of them."""

from __future__ import annotations

import json

import httpx
from cobot_run import WAIT_S, until

from panel.page import HOME, Panel, opened_card, set_to

LABEL = "Über <b>Kiste</b> 取料点"


def said(panel: Panel, text: str) -> None:
    panel.until(f"document.querySelector('#stored-why').innerText.includes({json.dumps(text)})")


def test_a_program_is_stored_opened_and_not_written_over(panel: Panel) -> None:
    """Oracle: what the service has, read over REST; the waypoints in the page."""
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        try:
            panel.page.click("#tab-program")
            opened_card(panel, "stored-card")
            panel.page.click("#stored-save")
            said(panel, "Enter a name first")
            panel.page.click("#teach")
            panel.page.write("#stored-name", LABEL)
            panel.page.click("#stored-save")
            said(panel, "is saved as version 1")
            (first,) = http.get("/programs").json()
            assert (first["label"], first["version"]) == (LABEL, 1)
            text = http.get(f"/programs/{first['id']}").json()["text"]
            assert len(json.loads(text)["waypoints"]) == 1

            theirs = {
                "label": LABEL,
                "text": json.dumps({"waypoints": [{"joints": HOME, "label": "theirs"}]}),
            }
            named = {"If-Match": '"1"', "X-Client-Name": "Anna"}
            http.put(f"/programs/{first['id']}", json=theirs, headers=named).raise_for_status()
            panel.page.click("#teach")
            panel.page.click("#stored-save")
            said(panel, "Anna")
            panel.page.click("#stored-other")
            said(panel, "is saved as version 1")
            labels = {each["label"]: each for each in http.get("/programs").json()}
            assert set(labels) == {LABEL, f"{LABEL} (2)"}
            assert labels[LABEL]["version"] == 2, "theirs is as it was"

            panel.until("document.querySelector('#stored').options.length === 2")
            for each in (labels[f"{LABEL} (2)"], first):
                set_to(panel, "#stored", each["id"])
            panel.until("document.querySelector('#stored-version').options.length === 2")
            set_to(panel, "#stored-version", "1")
            panel.page.click("#stored-open")
            said(panel, "is open, version 1")
            http.put(f"/programs/{first['id']}", json=theirs | {"note": "again"}, headers={"If-Match": '"2"'})
            panel.page.click("#stored-save")
            said(panel, "version 3")
            panel.page.click("#stored-theirs")
            said(panel, "is open, version 3")
            assert panel.page.run("cobotPanel.waypoints.list[0].label") == "theirs"
            panel.until("cobotPanel.stored.list.some((each) => each.version === 3)")
            set_to(panel, "#stored", first["id"])
            panel.page.click("#stored-delete")
            said(panel, "is deleted")
            until(lambda: len(http.get("/programs").json()) == 1)
        finally:
            for each in http.get("/programs").json():
                http.delete(f"/programs/{each['id']}")
            panel.page.run("localStorage.clear()")
            panel.load()

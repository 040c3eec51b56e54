"""Inputs, outputs, recordings, events, curves: what the panel lets a person look at beside the arm."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, until
from websockets.sync.client import connect

from panel.page import (
    Panel,
    opened_card,
    set_to,
)


def test_outputs_are_switched_and_registers_written(panel: Panel) -> None:
    """Oracle: the vendor services of the same robot."""
    name = httpx.get(f"{panel.run.url}/robots", timeout=WAIT_S).json()[0]["name"]

    def called(method: str, **fields: Any) -> Any:
        answer = httpx.post(f"{panel.run.url}/{name}/{method}", json=fields, timeout=WAIT_S).json()
        assert answer["code"] == 0, answer
        return answer["result"]

    opened_card(panel, "io")
    try:
        third = "#io-Output button:nth-of-type(3)"
        panel.until(f"document.querySelector('{third}')")
        panel.page.click(third)
        until(lambda: called("IoControl/getStandardDigitalOutput", index=2))
        panel.until(f"document.querySelector('{third}').getAttribute('aria-pressed') === 'true'")
        panel.page.click(third)
        until(lambda: not called("IoControl/getStandardDigitalOutput", index=2))
        called("IoControl/setStandardDigitalInput", index=1, value=True)
        second = "#io-Input button:nth-of-type(2)"
        panel.until(f"document.querySelector('{second}').ariaPressed === 'true'")
        panel.page.click(second)
        until(lambda: not called("IoControl/getStandardDigitalInput", index=1))
        set_to(panel, "#register-bank", "Output")
        set_to(panel, "#register-kind", "Int32")
        set_to(panel, "#register-index", "7")
        set_to(panel, "#register-value", "-12")
        panel.page.click("#register-write")
        until(lambda: called("RegisterControl/getInt32Output", index=7) == -12)
        panel.until("document.querySelector('#register-shown').innerText === '-12'")
        called("RegisterControl/setInt32Output", index=7, value=0)
    finally:
        panel.page.run("document.querySelector('#io').open = false")


def test_recordings_are_made_listed_over_their_time_and_taken_away(panel: Panel, tmp_path: Path) -> None:
    opened_card(panel, "recordings")
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:

        def names() -> list[str]:
            return [each["name"] for each in http.get("/recordings").json()["recordings"]]

        before = names()
        try:
            panel.page.click("#rec-dump")
            until(lambda: len(names()) > len(before))
            made = next(name for name in names() if name not in before)
            panel.until(f"document.querySelector('[data-recording=\"{made}\"] button')")
            assert "asked for" in panel.text(f'[data-recording="{made}"]')
            panel.page.click(f'[data-recording="{made}"] button')
            panel.until("!document.querySelector('#rec-shown').hidden && cobotPanel.view.still !== null")
            path = http.get(f"/recordings/{made}/path?samples=400").json()
            assert panel.page.run("cobotPanel.view.still") == pytest.approx(path["duration_s"])
            assert panel.page.run("cobotPanel.recordings.shown.path") == path["path"]
            events = panel.page.run("document.querySelectorAll('#rec-events li').length")
            assert events == len(path["events"][-100:]) > 0
            panel.page.click("#rec-events button")
            first = path["events"][-100:][0]["time_s"]
            panel.until(f"Math.abs(cobotPanel.view.still - {first}) < 1e-6")
            set_to(panel, "#rec-time", "0.5")
            panel.until("cobotPanel.view.still === 0.5")
            mine = f'[data-recording="{made}"] button:nth-of-type(2)'
            assert panel.page.save(mine, tmp_path).read_bytes() == http.get(f"/recordings/{made}").content
            panel.page.click("#rec-close")
            panel.until("!cobotPanel.view.ghost && document.querySelector('#rec-shown').hidden")
            count = panel.page.run("document.querySelectorAll('#rec-line line').length")
            assert count == len(names())
            panel.page.click("#rec-run")
            panel.until("document.querySelector('#rec-run').innerText === 'End the recording'")
            assert http.get("/recordings").json()["recorder"]["recording"]
            panel.page.click("#rec-run")
            panel.until("document.querySelector('#rec-run').innerText === 'Record'")
            assert not http.get("/recordings").json()["recorder"]["recording"]
        finally:
            panel.page.run("document.querySelector('#recordings').open = false")
            for name in set(names()) - set(before):
                http.delete(f"/recordings/{name}").raise_for_status()


def happened(panel: Panel) -> list[dict[str, Any]]:
    """All events that are kept."""
    address = f"ws{panel.run.url.removeprefix('http')}/events?after=0"
    with connect(address) as socket:
        newest = json.loads(socket.recv(WAIT_S))["data"]["newest"]
        events = [json.loads(socket.recv(WAIT_S))]
        while events[-1]["id"] < newest:
            events.append(json.loads(socket.recv(WAIT_S)))
    return events


def test_what_has_happened_is_listed_and_nothing_is_missed(panel: Panel) -> None:
    """The events as another connection hears them; after a break the list goes on where it was."""
    when = "e.querySelector('time').dateTime"
    listed = f"[...document.querySelectorAll('#log li')].map((e) => [e.dataset.type, {when}])"

    def all_listed() -> bool:
        newest = happened(panel)[:-101:-1]
        return bool(panel.page.run(listed) == [[each["type"], each["time"]] for each in newest])

    until(all_listed)
    panel.page.run("cobotPanel.events.socket.close()")
    assert httpx.post(f"{panel.run.url}/stop", timeout=WAIT_S).status_code == 200
    until(all_listed)
    assert (
        panel.page.run("document.querySelector('#log [data-type=stop]:not([data-detail]) b').dataset.level")
        == "warn"
    )
    named = httpx.post(f"{panel.run.url}/robot/move/named", json={"name": "nowhere"}, timeout=WAIT_S)
    assert named.status_code == 422
    refused = "document.querySelector('#log [data-type=refused] summary')"
    panel.until(refused)
    try:
        for language, name in (("de", "abgelehnt"), ("zh", "已拒绝"), ("en", "refused")):
            set_to(panel, "#language", language)
            assert panel.page.run(f"{refused}.children[1].innerText") == name
            said = str(panel.page.run(f"{refused}.children[2].innerText"))
            title = str(panel.page.run(f"{refused}.children[2].title"))
            assert title.startswith("POST /robot/move/named")
            assert "POST" not in said
            assert named.json()["detail"] in said
    finally:
        set_to(panel, "#language", "en")
    panel.page.click("#log [data-type=refused] summary")
    fields = "document.querySelector('#log [data-type=refused] pre')?.textContent"
    panel.until(fields)
    assert f"reason: {named.json()['detail']}" in panel.page.run(fields), "a line opens to all its fields"
    set_to(panel, "#language", "de")
    panel.until(f"document.querySelector('#log [data-type=refused] details').open && {fields}")
    assert panel.page.run(f"{refused}.children[1].innerText") == "abgelehnt"
    set_to(panel, "#language", "en")
    shown = "[...document.querySelectorAll('#log li')].filter((each) => each.checkVisibility())"
    for nth, kept in (
        (2, "'problem' in each.dataset"),
        (3, "true"),
        (1, "!('detail' in each.dataset)"),
    ):
        panel.page.click(f"#log-filter label:nth-child({nth})")
        expected = f"[...document.querySelectorAll('#log li')].filter((each) => {kept}).length"
        assert panel.page.run(f"{shown}.length > 0 && {shown}.length === {expected}")


def test_the_last_seconds_of_each_joint_are_drawn(panel: Panel) -> None:
    """The values as REST has them; a curve is where the canvas has colour."""
    panel.page.run("document.querySelector('#live').scrollIntoView()")
    for quantity, field in (("effort", "effort"), ("velocity", "velocity"), ("position", "position")):
        set_to(panel, "#live-what", quantity)
        values = httpx.get(f"{panel.run.url}/robot/joint_states", timeout=WAIT_S).json()[field]
        shown = float(values[3]) * (1.0 if quantity == "effort" else 180.0 / np.pi)
        near = "Math.abs(parseFloat(document.querySelectorAll('#live b')[3].innerText)"
        panel.until(f"{near} - ({shown})) < 0.5")
        named = "document.querySelectorAll('#live canvas')[3].getAttribute('aria-label')"
        assert "joint4" in panel.page.run(named)
    coloured = (
        "[...document.querySelectorAll('#live canvas')].every((each) => each.getContext('2d')"
        ".getImageData(0, 0, each.width, each.height).data.some((value) => value))"
    )
    panel.until(coloured)
    before = panel.run.health()["rtloop"]["overruns"]  # type: ignore[index]
    for quantity, lanes, shown in (("error", 7, " °"), ("wrench", 6, " N"), ("cycle", 2, " µs")):
        set_to(panel, "#live-what", quantity)
        panel.until(f"document.querySelectorAll('#live b').length === {lanes}")
        panel.until(f"document.querySelector('#live b').innerText.endsWith('{shown}')")
        panel.until(coloured)
    newest = "cobotPanel.live.states.at(-1)"
    panel.until(f"{newest}.cycle[0] > 0 && {newest}.cycle[1] >= {before}")
    assert (
        panel.page.run("document.querySelector('#live canvas').ariaLabel")
        == "cycle time of period, the last 20 s"
    )
    error = f"{newest}.error.every((each, joint) => Math.abs(each) < 0.02)"
    panel.until(f"{error} && {newest}.wrench.length === 6")
    set_to(panel, "#live-what", "position")
    span = "cobotPanel.live.states.at(-1).time - cobotPanel.live.states[0].time"
    assert panel.page.run(f"{span} < 20.1 && {span} > 0")
    assert panel.page.run("cobotPanel.live.lanes.length") == 7


def test_what_is_a_problem_is_told_by_what_has_happened(panel: Panel) -> None:
    levels = {
        "bad": [
            {"type": "job", "data": {"state": "failed"}},
            {"type": "job", "data": {"state": "interrupted"}},
            {"type": "motion", "data": {"what": "failed"}},
            {"type": "mode", "data": {"mode": "FAULT"}},
            {"type": "sequence", "data": {"what": "ended", "returncode": 2}},
            {"type": "log", "data": {"level": "error"}},
            {"type": "lost", "data": {}},
        ],
        "warn": [
            {"type": "log", "data": {"level": "warning"}},
            {"type": "lease", "data": {"what": "taken over"}},
            {"type": "planning", "data": {"what": "replaced"}},
        ],
        "": [
            {"type": "job", "data": {"state": "finished"}},
            {"type": "motion", "data": {"what": "begun"}},
            {"type": "sequence", "data": {"what": "ended", "returncode": 0}},
            {"type": "lease", "data": {"what": "taken"}},
        ],
    }
    for level, events in levels.items():
        found = f"import('/panel/log.js').then((all) => {json.dumps(events)}.map(all.levelOf))"
        assert panel.page.run(found) == [level] * len(events)

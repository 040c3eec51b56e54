"""Motions are planned, shown, run, followed, slowed down and approved."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, until
from PIL import Image

from cobot.clock import SYSTEM
from panel.page import (
    HOME,
    PICTURES,
    Panel,
    away,
    button,
    forget,
    planned,
    set_to,
    slowly,
    tcp_at,
)


def close_note(panel: Panel) -> None:
    """Close the note about the stop with which `Run.go_home` begins: where no motion follows, it stays."""
    if not panel.page.run("document.querySelector('#halt').hidden"):
        panel.page.click("#halt-close")


def test_a_motion_is_shown_before_it_is_run(panel: Panel) -> None:
    set_to(panel, "#motion-speed", "100")
    planned(panel, "work")
    assert "Takes" in panel.text("#plan")
    assert "mm" in panel.text("#plan")
    frames = panel.page.run("cobotPanel.view.frames")
    panel.until(f"cobotPanel.view.ghost && cobotPanel.view.frames > {frames} + 5")
    np.testing.assert_allclose(panel.run.joints(), HOME, atol=5e-3)
    panel.page.run("void (window.shown = cobotPanel.view.ghost)")
    panel.page.click("#discard")
    panel.until("!cobotPanel.view.ghost && document.querySelector('#execute').disabled")
    planned(panel, "work")
    assert panel.page.run("cobotPanel.view.ghost === window.shown"), "the ghost is not made again"
    panel.page.click("#rehearse")
    panel.until("document.querySelector('#plan').innerText.startsWith('Simulation OK: ')")
    np.testing.assert_allclose(panel.run.joints(), HOME, atol=5e-3)
    if PICTURES:
        close_note(panel)
        panel.page.picture(Path(PICTURES) / "panel.png")
    panel.page.click("#execute")
    panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
    goals = {each["name"]: each["joints"] for each in httpx.get(f"{panel.run.url}/robot/positions").json()}
    np.testing.assert_allclose(panel.run.joints(), goals["work"], atol=5e-3)


@pytest.mark.skipif(not PICTURES, reason="no pictures are asked for")
def test_the_moving_picture_of_the_documents(panel: Panel) -> None:
    """A motion is planned, its ghost goes the way, the arm follows: slowly, so that a busy computer has many
    pictures of it, which are then shown faster.
    """
    shots: list[Image.Image] = []

    def shoot(least: int, goes_on: Callable[[], bool] = lambda: False) -> None:
        begun = len(shots)
        while len(shots) < begun + least or goes_on():
            shots.append(Image.open(io.BytesIO(panel.page.shot())).convert("RGB").resize((800, 500)))
            SYSTEM.sleep(0.3)

    set_to(panel, "#motion-speed", "5")
    panel.until("document.querySelector('#control').innerText === 'Free'")
    close_note(panel)
    shoot(3)
    planned(panel, "work")
    shoot(12)
    panel.page.click("#execute")
    shoot(1, lambda: panel.text("#plan") != "The arm has arrived.")
    shoot(1)
    assert PICTURES
    file = Path(PICTURES) / "panel.gif"
    together = Image.new("RGB", (800, 500 * len(shots)))
    for index, shot in enumerate(shots):
        together.paste(shot, (0, 500 * index))
    colours = together.quantize(128, Image.Quantize.MAXCOVERAGE, kmeans=1)  # one for all, or they flicker
    few = [shot.quantize(palette=colours, dither=Image.Dither.NONE) for shot in shots]
    lasts_ms = [120] * (len(few) - 1) + [1500]
    few[0].save(file, save_all=True, append_images=few[1:], duration=lasts_ms, loop=0, optimize=False)
    assert file.stat().st_size < 1_500_000


def speed(panel: Panel) -> float:
    return float(httpx.get(f"{panel.run.url}/robot/speed_override", timeout=WAIT_S).json()["fraction"])


def test_motions_are_slowed_paused_and_followed(panel: Panel) -> None:
    """The arm and the jobs as REST tells of them."""
    try:
        panel.page.reveal("#override-set")
        panel.page.run("document.querySelector('#override-set').focus()")
        panel.page.key("PageDown", "PageDown")
        until(lambda: speed(panel) == 0.9)
        set_to(panel, "#override-set", "50")
        until(lambda: speed(panel) == 0.5)
        panel.until("document.querySelector('#override-shown').innerText === '50 %'")
        slowly(panel)
        panel.until("document.querySelector('#progress').value > 0.001")
        panel.until("/^[0-9]+ s left[.]$/.test(document.querySelector('#job-left').innerText)")
        assert panel.text("#job").startswith("Running (requested by an unnamed client")
        panel.page.run("document.querySelector('#pause').focus()")
        panel.page.key("Enter", "Enter", "\r")
        panel.until("document.querySelector('#pause').innerText === 'Resume'")
        newest = httpx.get(f"{panel.run.url}/jobs?n=1", timeout=WAIT_S).json()["jobs"][0]
        assert newest["state"] == "paused"
        panel.page.click("#pause")
        panel.until("document.querySelector('#pause').innerText === 'Pause'")
        before = panel.run.joints()[0]
        until(lambda: panel.run.joints()[0] > before + 1e-3)
        panel.until("cobotPanel.view.way")
        ends = "cobotPanel.view.way.geometry.attributes.position.array.slice(-3)"
        end = [0.6, *HOME[1:]]
        np.testing.assert_allclose(panel.page.run(f"[...{ends}]"), tcp_at(panel, end), atol=1e-5)
        panel.page.click("#stop")
        panel.until("!cobotPanel.view.way")
        panel.until("document.querySelector('#job').innerText.startsWith('Stopped')")
        assert panel.page.run("document.querySelector('#pause').disabled")
        httpx.post(f"{panel.run.url}/robot/speed_override", json={"fraction": 0.0}, timeout=WAIT_S)
        panel.page.run("cobotPanel.job.look()")
        panel.until("document.querySelector('#override-shown').innerText === '0 %'")
    finally:
        set_to(panel, "#override-set", "100")
        until(lambda: speed(panel) == 1.0)


def test_while_the_arm_follows_a_plan_the_ghost_stays_at_its_end_and_is_hidden_there(panel: Panel) -> None:
    """Oracle: the last point of the plan; the arm is there, because the service says so."""
    set_to(panel, "#motion-speed", "5")
    planned(panel, "work")
    goal = panel.page.run("cobotPanel.motions.plan.path.at(-1).joints")
    shown = "cobotPanel.view.ghost.root.visible"
    panel.until(f"{shown} && cobotPanel.view.still === null")
    panel.page.click("#execute")
    panel.until("cobotPanel.view.still === cobotPanel.view.plan?.duration_s")
    panel.until(f"{shown} && !document.querySelector('#pause').disabled")
    panel.page.click("#pause")
    panel.until("document.querySelector('#pause').innerText === 'Resume'")
    assert panel.page.run(shown), "the arm is on its way"
    there = f"(view => (view.show({{position: {goal}}}), view.haunt(), view.ghost.root.visible))"
    assert not panel.page.run(f"{there}(cobotPanel.view)")
    panel.page.click("#stop")
    until(panel.rests)
    set_to(panel, "#motion-speed", "10")


def test_plans_of_others_are_approved_and_taken_back(panel: Panel) -> None:
    planned(panel, "work")
    panel.page.click("#discard")
    body = {"joints": [0.3, *HOME[1:]], "speed": 0.5}
    answer = httpx.post(f"{panel.run.url}/robot/plan/joints", json=body, timeout=WAIT_S).json()
    row = f'[data-plan="{answer["plan_id"]}"]'
    panel.until(f"document.querySelector('{row}')")
    assert f"{answer['duration_s']:.1f} s" in panel.text(row)
    own = panel.page.run("cobotPanel.motions.made.at(-1)")
    assert not panel.page.run(f"!!document.querySelector('[data-plan=\"{own}\"]')")

    def approved_by() -> str | None:
        plans = httpx.get(f"{panel.run.url}/robot/plans", timeout=WAIT_S).json()
        return {each["plan_id"]: each["approved_by"] for each in plans}[answer["plan_id"]]

    panel.page.click(f"{row} button")
    panel.until(f"document.querySelector('{row} button').innerText === 'Take back'")
    assert approved_by() == "anonymous"
    panel.page.click(f"{row} button")
    panel.until(f"document.querySelector('{row} button').innerText === 'Approve'")
    assert approved_by() is None


def test_a_plan_of_somebody_else_is_shown_before_it_is_approved(panel: Panel) -> None:
    body = {"joints": [0.4, *HOME[1:]], "speed": 0.5}
    answer = httpx.post(f"{panel.run.url}/robot/plan/joints", json=body, timeout=WAIT_S).json()
    row = f'[data-plan="{answer["plan_id"]}"]'
    panel.until(f"document.querySelector('{row}')")
    panel.page.click(f"{row} button:nth-of-type(2)")
    panel.until("cobotPanel.view.ghost && document.querySelector('#plan').innerText.includes('Takes')")
    assert panel.page.run("cobotPanel.view.plan.plan_id") == answer["plan_id"]
    assert panel.page.run("document.querySelector('#execute').disabled"), "it is not the panel's to run"
    panel.page.click("#discard")
    panel.until("!cobotPanel.view.ghost")


def test_the_speed_that_somebody_else_sets_is_heard_of(panel: Panel) -> None:
    try:
        for fraction in (0.4, 1.0):
            body = {"fraction": fraction}
            httpx.post(f"{panel.run.url}/robot/speed_override", json=body, timeout=WAIT_S).raise_for_status()
            panel.until(f"document.querySelector('#override-shown').innerText === '{100 * fraction:.0f} %'")
    finally:
        httpx.post(f"{panel.run.url}/robot/speed_override", json={"fraction": 1.0}, timeout=WAIT_S)


QUEUED = 12
"""More than the newest ten: what goes on is older than those that wait for it."""


def test_what_waits_in_the_queue_is_listed_and_taken_out(panel: Panel) -> None:
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        try:
            http.post("/robot/speed_override", json={"fraction": 0.0}).raise_for_status()
            jobs = []
            for angle in np.linspace(0.1, 1.2, QUEUED).tolist():
                body = {"joints": [angle, *HOME[1:]], "speed": 1.0}
                jobs.append(
                    http.post("/robot/move/joints?queue=true", json=body).raise_for_status().json()["id"]
                )
            panel.until(f"document.querySelectorAll('#queue li').length === {QUEUED}")
            panel.until("document.querySelector('#job').innerText.startsWith('Paused (requested by ')")
            listed = panel.page.run(
                "[...document.querySelectorAll('#queue li')].map((each) => each.dataset.job)"
            )
            assert listed == jobs
            panel.page.click(f'[data-job="{jobs[1]}"] button')
            panel.until(f"document.querySelectorAll('#queue li').length === {QUEUED - 1}")
            assert http.get(f"/jobs/{jobs[1]}").json()["state"] == "cancelled"
            panel.page.click("#stop")
            panel.until("document.querySelector('#queue-card').hidden")
            until(lambda: http.get(f"/jobs/{jobs[2]}").json()["state"] == "cancelled")
        finally:
            http.post("/robot/speed_override", json={"fraction": 1.0}).raise_for_status()


def test_a_place_is_taught_gone_to_and_forgotten(panel: Panel) -> None:
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        place = [0.25, *HOME[1:]]
        assert http.post("/robot/move/joints", json={"joints": place, "speed": 1.0}).json()["success"]
        panel.until("Math.abs(cobotPanel.state?.commanded_position[0] - 0.25) < 1e-4")
        set_to(panel, "#position-name", "bench")
        panel.page.click("#position-teach")
        panel.until("document.querySelector('[data-position=bench]')")
        taught = {each["name"]: each for each in http.get("/robot/positions").json()}["bench"]
        assert taught["taught"]
        np.testing.assert_allclose(taught["joints"], place, atol=1e-4)
        panel.run.go_home()
        set_to(panel, "#motion-speed", "100")
        planned(panel, "bench")
        assert panel.text("#position-teach") == "Replace"
        panel.page.click("#execute")
        panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
        np.testing.assert_allclose(panel.run.joints(), place, atol=5e-3)
        panel.until("/^Done at [0-9:]{8} \\(requested by /.test(document.querySelector('#job').innerText)")
        planned(panel, "work")
        assert panel.page.run("document.querySelector('#position-name').value") == "", "it cannot be saved"
        assert panel.text("#position-teach") == "Save"
        panel.page.click("#discard")
        set_to(panel, "#position-name", "home")
        panel.page.click("#position-teach")
        panel.until("document.querySelector('#plan').innerText.startsWith('This name is already in use')")
        assert panel.page.run("document.querySelector('#position-forget').disabled")
        set_to(panel, "#position-name", "bench")
        panel.page.click("#position-forget")
        panel.until("!document.querySelector('[data-position=bench]')")
        assert "bench" not in [each["name"] for each in http.get("/robot/positions").json()]
        taught_in_any_language(panel, http)
        http.post("/robot/positions", json={"name": "elsewhere", "joints": place}).raise_for_status()
        panel.until("document.querySelector('[data-position=elsewhere]')")
        http.delete("/robot/positions/elsewhere").raise_for_status()
        panel.until("!document.querySelector('[data-position=elsewhere]')")
        forget(panel, "409")


WALL = {"shape": "box", "size": [0.8, 0.04, 0.9], "x": 0.6, "y": 0.0, "z": 0.45}
ASIDE = [0.6, 0.0, -1.4, 0.0, 1.1416, 0.0]
"""Joints 2 to 7 next to the wall, low enough that the arm has to go over it."""


def test_a_way_around_an_obstacle_is_found_and_made_faster(panel: Panel) -> None:
    """Oracle: the plans as the service keeps them, with the duration of the first motion."""
    text = "document.querySelector('#plan').innerText"
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        try:
            body = {"joints": [-0.9, *ASIDE], "speed": 1.0}
            assert http.post("/robot/move/joints", json=body).json()["success"]
            position = {"name": "behind", "joints": [0.9, *ASIDE]}
            http.post("/robot/positions", json=position).raise_for_status()
            panel.until("document.querySelector('[data-position=behind]')")
            planned(panel, "behind")
            assert panel.page.run("document.querySelector('#improve').hidden"), "it goes the direct way"
            http.post("/scene", json={"objects": {"wall": WALL}}).raise_for_status()
            planned(panel, "behind")
            assert "the motion goes around it" in panel.text("#plan")
            panel.page.click("#improve")
            planned(panel, "behind")  # while the other one is being improved
            panel.until("!document.querySelector('#improve').disabled")
            first = panel.page.run("cobotPanel.motions.plan.plan_id")
            panel.page.click("#improve")
            panel.until(f"{text}.includes('% faster than the first motion found')")
            shown = panel.page.run("cobotPanel.motions.plan.plan_id")
            before, after = (http.get(f"/robot/plans/{each}").json()["duration_s"] for each in (first, shown))
            assert after < 0.99 * before
            gain = f"{100 * (1 - after / before):.0f} % faster than the first motion found ({before:.1f} s)."
            assert f"Takes {after:.1f} s. {gain}" in panel.text("#plan")
            set_to(panel, "#language", "de")
            assert "% schneller als" in panel.text("#plan")
            set_to(panel, "#language", "en")
            panel.until("!document.querySelector('#execute').disabled && !cobotPanel.motions.busy")
            http.post("/scene", json={"clear": True}).raise_for_status()
            panel.page.click("#improve")
            panel.until(f"{text} === 'The surroundings have changed since it was planned. Plan again.'")
            np.testing.assert_allclose(panel.run.joints(), [-0.9, *ASIDE], atol=5e-3)
            panel.page.click("#discard")
            assert panel.page.run("document.querySelector('#improve').hidden")
            forget(panel, "409")
        finally:
            http.post("/scene", json={"clear": True}).raise_for_status()
            http.delete("/robot/positions/behind").raise_for_status()


def taught_in_any_language(panel: Panel, http: httpx.Client) -> None:
    """Enter saves; people see the label, programs the id."""
    panel.page.write("#position-name", "Über Kiste 1")
    panel.page.run("document.querySelector('#position-name').focus()")
    panel.page.key("Enter", "Enter")
    shown = "[...document.querySelectorAll('#positions button')].map((each) => each.textContent)"
    panel.until(f"{shown}.includes('Über Kiste 1')")
    found = {each["label"]: each["name"] for each in http.get("/robot/positions").json()}
    assert re.fullmatch(r"uber-kiste-1-\w+", found["Über Kiste 1"])
    panel.run.go_home()
    for name in ("Kiste 2", "Kiste 3"):  # after Enter, and after a press on the field: not appended
        panel.until("document.querySelector('#plan').innerText.includes('Über Kiste 1')")
        panel.page.ask("Input.insertText", text=name)
        assert panel.page.run("document.querySelector('#position-name').value") == name
        panel.page.run("document.activeElement.blur()")
        panel.page.click("#position-name")
    planned(panel, found["Über Kiste 1"])
    assert "Über Kiste 1" in panel.text("#plan")
    panel.page.click("#position-forget")
    panel.until(f"!{shown}.includes('Über Kiste 1')")
    panel.page.click("#discard")


def test_who_has_taken_the_control_moves_the_arm_alone(panel: Panel) -> None:
    home = {"name": "home", "speed": 1.0}
    panel.page.click("#take")
    panel.until("document.querySelector('#take').innerText === 'Release control'")
    panel.until("document.querySelector('#control-who').textContent.startsWith('You · an unnamed client (')")
    refused = httpx.post(f"{panel.run.url}/robot/move/named", json=home, timeout=WAIT_S)
    assert refused.status_code == 409
    plus = button("joint", 0, 1)
    panel.hold(plus, away(panel, 0, 1, 0.0))
    panel.let_go(plus)
    panel.stays()
    planned(panel, "home")
    panel.page.click("#execute")
    panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
    panel.page.click("#take")
    panel.until("document.querySelector('#take').innerText === 'Take control'")
    answer = httpx.post(f"{panel.run.url}/robot/move/named", json=home, timeout=WAIT_S)
    assert answer.json()["success"], answer.text


def test_why_control_cannot_be_taken_is_shown_until_it_is_free(panel: Panel) -> None:
    why, control = "document.querySelector('#control-why').textContent", f"{panel.run.url}/robot/control"
    anna = {"X-Client-Name": "anna"}
    taken = httpx.post(control, json={}, headers=anna, timeout=WAIT_S).raise_for_status().json()
    try:
        panel.until("""document.querySelector('#control-who').textContent.startsWith('anna (')""")
        panel.page.click("#take")
        panel.until(f"{why}.startsWith('anna')")
        said = panel.page.run(why)
        set_to(panel, "#language", "de")
        assert "hat die Steuerung" in panel.page.run(why), "also in another language, without another event"
        set_to(panel, "#language", "en")
        assert panel.page.run(why) == said
    finally:
        anna["X-Control-Token"] = taken["token"]
        httpx.delete(control, headers=anna, timeout=WAIT_S).raise_for_status()
    panel.until("document.querySelector('#control').innerText === 'Free'")
    panel.until(f"{why} === ''")

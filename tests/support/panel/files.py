"""CSV files and Lua programs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cobot_run import until
from scipy.interpolate import BPoly, CubicSpline

from cobot.lua_functions import FUNCTIONS
from panel.page import (
    HOME,
    Panel,
    drop,
    rows_of,
    set_to,
)


def test_functions_are_offered_in_a_lua_program(panel: Panel) -> None:
    """Oracle: `cobot.lua_functions.FUNCTIONS`."""
    offers = "[...document.querySelectorAll('#offers li')].map((each) => each.firstChild.data)"
    hidden = "document.querySelector('#offers').hidden"
    text = "document.querySelector('#program-text').value"
    panel.page.click("#program-lua")
    try:
        panel.page.click("#program-text")
        for letter in "mo":
            panel.page.key(letter, f"Key{letter.upper()}", letter)
        panel.until(f"!{hidden}")
        assert panel.page.run(offers) == [name for name in FUNCTIONS if name.startswith("mo")]
        assert FUNCTIONS["move"] in panel.text("#offers")
        wanted = panel.page.run(offers).index("moveJoint")
        for _ in range(wanted):
            panel.page.key("ArrowDown", "ArrowDown")
        panel.page.key("Enter", "Enter", "\r")
        assert panel.page.run(text) == "moveJoint("
        assert panel.page.run(hidden)
        for letter in ")\rgripper.g":
            key = {"\r": "Enter", ")": "Digit0", ".": "Period"}.get(letter, f"Key{letter.upper()}")
            panel.page.key("Enter" if letter == "\r" else letter, key, letter)
        assert panel.page.run(offers) == ["gripper.grasp"]
        panel.page.key("Tab", "Tab")
        assert panel.page.run(text) == "moveJoint()\ngripper.grasp "
        panel.until("cobotPanel.programPage.program.document.text.endsWith('gripper.grasp ')")
        panel.page.key("z", "KeyZ", "z")
        panel.page.key("z", "KeyZ", "z")
        assert panel.page.run(hidden), "no function begins so"
    finally:
        panel.page.run("localStorage.clear()")
        panel.load()


def test_a_lua_program_is_run_and_its_mistakes_are_marked(panel: Panel) -> None:
    panel.page.click("#program-lua")
    try:
        program = "movej({ 0.2, 0, 0, -1.57, 0, 1.57, 0 }, 1.0)\nprint('there')\n"
        set_to(panel, "#program-text", program)
        assert panel.text("#program-lines").split() == ["1", "2", "3"]
        panel.page.click("#lua-run")
        panel.until("document.querySelector('#lua-why').innerText === 'Has ended well.'")
        assert "there" in panel.text("#lua-log")
        np.testing.assert_allclose(panel.run.joints(), [0.2, *HOME[1:]], atol=5e-3)
        set_to(panel, "#program-text", "print('one')\nmovej({ 9, 0, 0, 0, 0, 0, 0 })\n")
        panel.page.click("#lua-run")
        panel.until("document.querySelector('#lua-why').innerText.startsWith('Ended with 2')")
        assert "joint1" in panel.text("#lua-why")
        shown = panel.text("#lua-log").splitlines()
        assert shown[0] == "one", "nothing of the run before, of the runner or of the clock"
        assert "there" not in shown
        begin = panel.page.run("document.querySelector('#program-text').selectionStart")
        assert begin == len("print('one')\n"), "the second line is selected"
    finally:
        panel.page.run("localStorage.clear()")
        panel.load()


def test_a_csv_file_is_looked_at_before_it_is_sent(panel: Panel) -> None:
    """Oracle: of velocities SciPy's clamped cubic spline."""
    times, angles = [0.0, 1.5, 3.0, 5.0], [0.0, 0.2, 0.25, 0.1]
    drop(panel, "#csv-why", "wave.csv", rows_of(times, angles))
    panel.until("document.querySelectorAll('#csv-plots svg').length === 14")
    assert "4 points, 5.00 s" in panel.text("#csv-why")
    shown = np.array(panel.page.run("cobotPanel.csv.shown[0].velocities"))
    exact = CubicSpline(times, angles, bc_type="clamped").derivative()
    np.testing.assert_allclose(shown[:, 1], exact(shown[:, 0]), atol=1e-12)
    dense = np.abs(exact(np.linspace(0.0, 5.0, 5001))).max()
    assert np.abs(shown[:, 1]).max() == pytest.approx(dense, rel=1e-4)
    np.testing.assert_allclose(panel.run.joints(), HOME, atol=5e-3)
    panel.page.click("#csv-send")
    panel.until("document.querySelector('#csv-why').innerText.startsWith('Moves for 5.0 s')")
    until(lambda: panel.rests() and abs(panel.run.joints()[0] - 0.1) < 5e-3)

    drop(panel, "#csv-why", "fast.csv", rows_of([0.0, 0.05], [0.1, 4.0]))
    panel.until("document.querySelector('#csv-why').innerText.includes('J1 reaches')")
    assert "J1 leaves its range" in panel.text("#csv-why")
    assert panel.page.run("document.querySelectorAll('#csv-plots .beyond').length") == 2
    panel.page.click("#csv-send")
    panel.until("document.querySelector('#csv-why').innerText.includes('J1: 229° is beyond the limit of')")

    drop(panel, "#csv-why", "away.csv", rows_of([0.0, 2.0], [0.3, 0.4]))
    panel.until("document.querySelector('#csv-why').innerText.includes('away.csv')")
    panel.page.click("#csv-start")
    panel.page.click("#csv-send")
    until(lambda: panel.rests() and abs(panel.run.joints()[0] - 0.4) < 5e-3)
    panel.page.click("#csv-start")
    assert not panel.page.run("document.querySelector('#csv-start').checked")

    drop(panel, "#csv-why", "other.csv", "a,b\n1,2\n")
    panel.until("document.querySelector('#csv-why').innerText.startsWith('other.csv is not a trajectory')")
    assert panel.page.run("document.querySelector('#csv-send').disabled")


def test_a_json_trajectory_is_looked_at_before_it_is_sent(panel: Panel) -> None:
    """Oracle: SciPy's clamped cubic spline; where the arm gets to."""
    times, angles = [0.0, 1.5, 3.0], [0.0, 0.2, 0.15]
    points = [
        {"positions": [angle, *HOME[1:]], "time_from_start": time}
        for time, angle in zip(times, angles, strict=True)
    ]
    drop(panel, "#csv-why", "wave.json", json.dumps({"points": points}))
    panel.until("document.querySelectorAll('#csv-plots svg').length === 14")
    assert "3 points, 3.00 s" in panel.text("#csv-why")
    shown = np.array(panel.page.run("cobotPanel.csv.shown[0].velocities"))
    exact = CubicSpline(times, angles, bc_type="clamped").derivative()
    np.testing.assert_allclose(shown[:, 1], exact(shown[:, 0]), atol=1e-12)
    np.testing.assert_allclose(panel.run.joints(), HOME, atol=5e-3)
    panel.page.click("#csv-send")
    panel.until("document.querySelector('#csv-why').innerText.startsWith('Moves for 3.0 s')")
    until(lambda: panel.rests() and abs(panel.run.joints()[0] - 0.15) < 5e-3)
    for wrong in ("{", '{"points": []}', json.dumps({"points": [{"positions": [0], "time_from_start": 0}]})):
        drop(panel, "#csv-why", "other.json", wrong)
        panel.until("document.querySelector('#csv-why').innerText.includes('json is not a trajectory')")


def test_files_are_chosen_and_taken_away(panel: Panel, tmp_path: Path) -> None:
    fast = tmp_path / "fast.csv"
    fast.write_text(rows_of([0.0, 0.1], [0.0, 0.3]), encoding="utf-8")
    panel.page.choose("#csv-choose", fast)
    panel.until("document.querySelector('#csv-why').innerText.includes('J1 reaches')")
    panel.page.click("#csv-retime")
    panel.page.click("#csv-send")
    panel.until("document.querySelector('#csv-why').innerText.startsWith('Moves for')")
    until(lambda: panel.rests() and abs(panel.run.joints()[0] - 0.3) < 5e-3)
    panel.page.click("#csv-retime")
    assert panel.page.run("document.querySelector('#csv-file').value") == ""

    try:
        program = tmp_path / "hello.lua"
        program.write_text('print("hello")\n', encoding="utf-8")
        panel.page.choose("#program-import", program)
        panel.until("document.querySelector('#program-text').value.includes('hello')")
        assert panel.page.run("document.querySelector('#program-file').value") == ""
        folder = tmp_path / "exported"
        folder.mkdir()
        exported = panel.page.save("#program-export", folder)
        assert (exported.name, exported.read_text()) == ("hello.lua", program.read_text())
    finally:
        panel.page.run("localStorage.clear()")
        panel.load()


def test_of_a_csv_file_with_accelerations_the_curves_are_those_that_are_run(panel: Panel) -> None:
    """Oracle: SciPy's piecewise polynomials through the same values."""
    times, places, rates, bends = [0.0, 0.8, 2.0], [0.0, 0.3, 0.2], [0.0, 0.1, 0.0], [0.0, -1.5, 0.0]
    columns = json.dumps([times, places, rates, bends])
    curve = f"import('/panel/points.js').then((all) => all.velocityCurve(...{columns}))"
    shown = np.array(panel.page.run(curve))
    exact = BPoly.from_derivatives(times, np.transpose([places, rates, bends])).derivative()
    np.testing.assert_allclose(shown[:, 1], exact(shown[:, 0]), atol=1e-9)
    dense = exact(np.linspace(0.0, 2.0, 20001))
    np.testing.assert_allclose([shown[:, 1].min(), shown[:, 1].max()], [dense.min(), dense.max()], atol=1e-4)
    header = [f"{kind}{joint}" for kind in ("joint", "velocity", "acceleration") for joint in (1, 2)]
    rows = [
        [place, 0, rate, 0, bend, 0, time]
        for time, place, rate, bend in zip(times, places, rates, bends, strict=True)
    ]
    text = "\n".join(",".join(map(str, row)) for row in [[*header, "t"], *rows])
    read = panel.page.run(f"import('/panel/points.js').then((all) => all.read({json.dumps(text)}, 2))")
    assert read["accelerations"] == [bends, [0, 0, 0]]

"""The head of the panel, the picture of the arm, and values that are typed."""

from __future__ import annotations

import itertools
import json
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, until
from scipy.spatial.transform import Rotation

from panel.page import HOME, SIZE, Panel, commanded, is_at, set_to, size, slowly, tcp_at

VISIBLE = "cobotPanel.view.arm.hidden.filter(([mesh]) => mesh.visible)"
CONFIRMED = """
document.addEventListener("cobot-stopped", () => (window.toldAt = performance.now()), { capture: true });
new MutationObserver(() => (window.shownAt ??= performance.now()))
    .observe(document.querySelector("#stop"), { attributeFilter: ["data-confirmed"] });
"""
"""When the service has told the page that the arm is at rest, and when the button shows it."""
FIELD = "document.querySelector({!r})"


def test_the_head_says_what_the_robot_is_and_does(panel: Panel) -> None:
    """Oracle: GET /robots and GET /robot/control."""
    robot = httpx.get(f"{panel.run.url}/robots", timeout=WAIT_S).json()[0]
    panel.until("!document.querySelector('#simulation').hidden")
    assert panel.text("#robot-name") == robot["name"]
    assert panel.text("#robot-model") == robot["model"] == "iiwa14"
    assert panel.text("#mode") == "Ready"
    panel.page.click("#take")
    panel.until("document.querySelector('#control').innerText === 'You'")
    panel.page.click("#take")
    panel.until("document.querySelector('#control').innerText === 'Free'")
    places = """["#tab-run", "#override-part", "#control-part", "#help"].map((each) => {
        const { left, top, width } = document.querySelector(each).getBoundingClientRect();
        return [left, top, width];
    })"""
    for width, height in ((1280, 800), (1024, 768), (390, 844)):
        size(panel, width, height)
        free = panel.page.run(places)
        named = "document.querySelector('#control').textContent = 'an unnamed client ' + 'x'.repeat(40)"
        long = panel.page.run(f"({named}, {places})")
        assert long == free, "nothing moves under a finger when control changes hands"
    size(panel, *SIZE)
    panel.page.run("cobotPanel.status.look()")
    slowly(panel)
    panel.until("document.querySelector('#mode').innerText === 'Moving'")
    panel.until("parseFloat(document.querySelector('#tcp-speed').innerText.replace('TCP ', '')) > 0")
    panel.page.run(CONFIRMED)
    panel.page.click("#stop")
    panel.until("document.querySelector('#stop').dataset.confirmed !== undefined && window.toldAt")
    assert panel.page.run("shownAt - toldAt") < 100.0, "the button shows it within 100 ms of the confirmation"
    assert panel.page.run("getComputedStyle(document.querySelector('#stopped')).display") == "block"
    until(panel.rests)
    panel.until("document.querySelector('#stop').dataset.confirmed === undefined")
    panel.until("document.querySelector('#tcp-speed').innerText === 'TCP 0 mm/s'")


def test_the_arm_is_drawn_as_it_looks_and_on_request_as_the_checks_see_it(panel: Panel) -> None:
    """Oracle: the number of links with a mesh in GET /robot/visuals."""
    looks = httpx.get(f"{panel.run.url}/robot/visuals", timeout=WAIT_S).json()["visuals"]
    panel.until(f"cobotPanel.view.looks.size === {len({each['link'] for each in looks})}")
    assert panel.page.run(f"{VISIBLE}.every(([mesh, collides]) => !collides && mesh.userData.shared)")
    panel.page.click("#view-collision")
    assert panel.page.run(f"{VISIBLE}.length > 0 && {VISIBLE}.every(([mesh, collides]) => collides)")
    panel.page.click("#view-collision")
    assert panel.page.run(f"{VISIBLE}.every(([mesh, collides]) => !collides)")


@pytest.mark.parametrize("width", [390, 780, 1280])
def test_no_menu_opens_beyond_the_edge(panel: Panel, width: int) -> None:
    size(panel, width, 800)
    try:
        for menu in ("program-menu", "add"):
            inside = f"#{menu} .popup button"
            panel.page.reveal(inside)
            edges = panel.page.run(
                f"(({{left, right}}) => [left, innerWidth - right])"
                f"(document.querySelector('#{menu} .popup').getBoundingClientRect())"
            )
            assert min(edges) >= 0, (menu, edges)
            panel.page.click(f"#{menu} > summary")
    finally:
        size(panel, *SIZE)


def test_the_camera_goes_to_the_views_and_the_tcp_leaves_a_trace(panel: Panel) -> None:
    place = (
        "cobotPanel.view.camera.position.clone().sub(cobotPanel.view.controls.target).normalize().toArray()"
    )
    for view, axis, towards in (("front", 0, 0.9), ("top", 2, 0.9), ("iso", 0, 0.5), ("fit", 0, 0.5)):
        panel.page.click(f"#view-{view}")
        assert panel.page.run(place)[axis] > towards, view
    panel.page.click("#view-trace")
    body = {"joints": [0.2, *HOME[1:]], "speed": 1.0}
    assert httpx.post(f"{panel.run.url}/robot/move/joints", json=body, timeout=WAIT_S).json()["success"]
    near = f"Math.abs(cobotPanel.state?.position[0] - {body['joints'][0]}) < 2e-3"
    panel.until(f"{near} && cobotPanel.view.trace.length > 2")
    end = panel.page.run("cobotPanel.view.trace.at(-1)")
    np.testing.assert_allclose(end, tcp_at(panel, body["joints"]), atol=5e-3)
    panel.page.click("#view-trace")
    assert panel.page.run("cobotPanel.view.trace === null && cobotPanel.view.traceLine === null")


def test_the_clearance_is_a_line_between_the_nearest_points(panel: Panel) -> None:
    """Oracle: GET /robot/clearance; a ball over the TCP at home, by hand."""

    def line(of: str) -> list[list[float]]:
        ends = (
            f"cobotPanel.view.clearances.get('{of}').children.slice(1).map((ball) => ball.position.toArray())"
        )
        return list(panel.page.run(ends))

    shown = "document.querySelector('#clearance').innerText"
    x, y, z = tcp_at(panel, HOME)
    ball = {"shape": "sphere", "radius": 0.02, "x": x, "y": y, "z": z - 0.05}
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        try:
            http.post("/scene", json={"objects": {"ball": ball}}).raise_for_status()
            panel.until(f"{shown}.includes('ball')")
            found = http.get("/robot/clearance").json()["closest_environment"]
            assert sorted(found["between"]) == ["ball", "link7"]
            assert found["distance_m"] == pytest.approx(0.05 - 0.02, abs=2e-3)
            np.testing.assert_allclose(line("arm"), found["points"], atol=2e-3)
            assert panel.text("#clearance").startswith(f"Clearance {1000 * found['distance_m']:.0f} mm")
            hue = panel.page.run(
                "Number(document.querySelector('#clearance').style.getPropertyValue('--hue'))"
            )
            assert hue < 30, "red or orange"
            away = {"joints": [0.3, *HOME[1:]], "speed": 1.0}
            plan = http.post("/robot/plan/joints", json=away).json()
            row = f'[data-plan="{plan["plan_id"]}"]'
            panel.until(f"document.querySelector('{row}')")
            panel.page.click(f"{row} button:nth-of-type(2)")
            panel.until("cobotPanel.view.clearances.has('plan')")
            np.testing.assert_allclose(line("plan"), plan["closest_environment"]["points"], atol=1e-9)
            panel.page.click("#discard")
            panel.until("!cobotPanel.view.clearances.has('plan')")
            assert http.post("/robot/move/joints", json=away).json()["success"]
            panel.until(f"parseFloat({shown}.replace('Clearance ', '')) > 60")
            now = http.get("/robot/clearance").json()["closest_environment"]
            panel.until(
                f"{shown} === 'Clearance {1000 * now['distance_m']:.0f} mm ({' – '.join(now['between'])})'"
            )
            np.testing.assert_allclose(line("arm"), now["points"], atol=2e-3)
        finally:
            http.post("/scene", json={"clear": True}).raise_for_status()
    panel.until(f"!{shown}.includes('ball')")


def test_a_target_above_a_solid_is_over_its_highest_point_and_points_down(panel: Panel) -> None:
    """Oracle: SciPy's rotations of the solid's corners and of the axes of the tool."""
    rng = np.random.default_rng(29)
    for _ in range(20):
        tool, turned = Rotation.random(2, random_state=rng)
        size = rng.uniform(0.02, 0.3, 3)
        part = json.dumps({"shape": "box", "size": size.tolist(), "quaternion": turned.as_quat().tolist()})
        reach, down = panel.page.run(
            "import('/panel/parts.js').then((all) => "
            f"[all.reachOf({part}, [0, 0, 1]), all.downwards({tool.as_quat().tolist()}, [0, 0, 1], {part})])"
        )
        corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * size
        assert reach == pytest.approx(turned.apply(corners)[:, 2].max(), abs=1e-9)
        made = Rotation.from_quat(down)
        np.testing.assert_allclose(made.apply([0, 0, 1]), [0, 0, -1], atol=1e-9)
        flat = next(edge for edge in turned.as_matrix().T if abs(edge[2]) < 0.7)[:2]
        sine = np.cross([*flat, 0.0], made.apply([1, 0, 0]))[2] / np.linalg.norm(flat)
        angle = np.degrees(np.arcsin(np.clip(sine, -1, 1)))
        assert min(abs(angle), abs(abs(angle) - 90.0)) < 1e-4, "the fingers are in line with an edge"


def test_objects_of_the_scene_are_listed_and_the_arm_can_go_above_them(panel: Panel) -> None:
    """Oracle: the place that the scene was given, and the end of what the service plans."""
    ball = {"shape": "sphere", "radius": 0.05, "x": 0.55, "y": 0.2, "z": 0.2}
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        try:
            http.post("/scene", json={"objects": {"ball": ball}}).raise_for_status()
            panel.until("!document.querySelector('#places-of').hidden")
            panel.page.click("#places-of label:nth-child(2)")
            panel.page.click("#cell-list li button:nth-of-type(1)")
            panel.until("cobotPanel.view.pointing.box?.visible")
            assert panel.text("#cell-list span").split() == ["550", "200", "200"]
            panel.page.click("#cell-list li button:nth-of-type(2)")
            panel.until("!document.querySelector('#execute').disabled")
            end = panel.page.run("cobotPanel.motions.plan.path.at(-1).position")
            np.testing.assert_allclose(end, [0.55, 0.2, 0.35], atol=1e-4)
            assert panel.text("#plan").startswith("To ball + 100 mm.")
            panel.page.click("#discard")
            panel.page.click("#places-of label:nth-child(1)")
        finally:
            http.post("/scene", json={"clear": True}).raise_for_status()
    panel.until("document.querySelector('#places-of').hidden")


def test_a_typed_value_is_planned_and_a_second_enter_runs_it(panel: Panel) -> None:
    """Oracle: where the arm is commanded to, and where the service has the TCP."""

    def type_and_plan(selector: str, text: str) -> None:
        panel.page.click(selector)
        panel.page.ask("Input.insertText", text=text)
        panel.page.key("Enter", "Enter", "\r")
        panel.until("!document.querySelector('#execute').disabled")

    def run() -> None:
        panel.page.key("Enter", "Enter", "\r")
        panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")

    set_to(panel, "#motion-speed", "100")
    first = "#joints .row:nth-child(1) input"
    type_and_plan(first, "11,5")
    assert is_at(panel, HOME), "a plan moves nothing"
    assert panel.text("#plan").startswith("To J1 11,5.")
    run()
    np.testing.assert_allclose(commanded(panel), [np.radians(11.5), *HOME[1:]], atol=1e-6)
    before = tcp_at(panel, commanded(panel))
    type_and_plan("#tcp .row:nth-child(3) input", f"{1000 * before[2] - 20:.3f}")
    run()
    np.testing.assert_allclose(np.subtract(tcp_at(panel, commanded(panel)), before), [0, 0, -0.02], atol=1e-5)
    type_and_plan("#tcp .row:nth-child(1) input", f"{1000 * before[0] - 20:.3f}")
    type_and_plan("#tcp .row:nth-child(3) input", f"{1000 * before[2]:.3f}")
    run()
    moved = np.subtract(tcp_at(panel, commanded(panel)), before)
    np.testing.assert_allclose(moved, [-0.02, 0, 0], atol=1e-5, err_msg="both values count")
    type_and_plan("#tcp .row:nth-child(1) input", f"{1000 * before[0]:.3f}")
    panel.page.click(first)
    panel.page.ask("Input.insertText", text="far")
    panel.page.key("Enter", "Enter", "\r")
    panel.until("document.querySelector('#plan').innerText.includes('is not a number')")
    panel.until("document.querySelector('#execute').disabled")
    panel.page.run(f"{FIELD.format(first)}.blur()")
    panel.until(f"{FIELD.format(first)}.value.endsWith(' °')")


def test_a_value_counts_that_is_typed_before_the_plan_of_the_one_before_it_is_there(panel: Panel) -> None:
    """Both Enter keys are pressed within one turn of the page, so the first plan cannot have come yet."""
    before = tcp_at(panel, commanded(panel))
    typed = [[1, f"{1000 * before[0] - 15:.3f}"], [2, f"{1000 * before[1] + 25:.3f}"]]
    panel.page.run(
        f"""for (const [row, value] of {json.dumps(typed)}) {{
            const field = document.querySelector(`#tcp .row:nth-child(${{row}}) input`);
            field.focus();
            field.value = value;
            field.dispatchEvent(new KeyboardEvent("keydown", {{ key: "Enter", bubbles: true }}));
            field.blur();
        }}"""
    )
    panel.until("cobotPanel.motions.plan && !document.querySelector('#execute').disabled")
    goal = panel.page.run("cobotPanel.motions.plan.path.at(-1).position")
    np.testing.assert_allclose(np.subtract(goal, before), [-0.015, 0.025, 0.0], atol=5e-4)
    panel.page.click("#discard")


def test_only_one_plain_number_in_the_unit_of_its_field_is_taken(panel: Panel) -> None:
    """Any other text is none: a wrong number would move the arm to a wrong place."""
    given = {
        "11,5": 11.5, "-20": -20.0, "−0.5 °": -0.5, " 7 ": 7.0, "90°": 90.0,
        "1.234,5": None, "1,234.5": None, "20 mm": None, "1e3": None, "20abc": None, "": None,
    }  # fmt: skip
    for text, number in given.items():
        call = f"import('/panel/typed.js').then((all) => all.numberOf({json.dumps(text)}, '°'))"
        assert panel.page.run(f"{call}.then((found) => Number.isNaN(found) ? null : found)") == number, text


def test_joint_names_are_shortened_to_what_is_different(panel: Panel) -> None:
    given = {
        "J1 J2 J7": ["panda_joint1", "panda_joint2", "panda_joint7"],
        "shoulder_pan elbow wrist_1": ["shoulder_pan_joint", "elbow_joint", "wrist_1_joint"],
        "rail turn": ["rail", "turn"],
        "alone": ["alone"],
    }
    for short, names in given.items():
        found = panel.page.run(f"import('/panel/joint-names.js').then((all) => all.shortNames({names}))")
        assert " ".join(found) == short


def test_a_message_names_joints_as_the_fields_do(panel: Panel) -> None:
    name = panel.page.run("cobotPanel.readouts.ranges[5].name")
    label = panel.page.run("document.querySelectorAll('#joints .row span')[5].textContent")
    assert label != name
    error = json.dumps({"detail": f"{name} is at its limit"})
    said = panel.page.run(f"import('/panel/reasons.js').then((all) => all.reasonOf({error}))")
    assert said == f"{label} is at its limit"


def test_the_end_of_a_motion_on_another_day_has_its_date(panel: Panel) -> None:
    call = "import('/panel/words.js').then((all) => all.dayAndTime({}))"
    assert "2020" in panel.page.run(call.format("'2020-03-04T05:06:07Z'"))
    assert panel.page.run(call.format("new Date().toISOString()")).count(":") == 2
    assert len(panel.page.run(call.format("new Date().toISOString()"))) == len("05:06:07")


def test_a_long_text_under_the_picture_is_shown_whole_and_moves_nothing(panel: Panel) -> None:
    def say(text: str) -> None:
        panel.page.run(f"cobotPanel.motions.say(() => {json.dumps(text)})")

    def places() -> Any:
        of = "[...document.querySelectorAll('#view, #side, #execute, #stop')]"
        return panel.page.run(f"{of}.map((each) => JSON.stringify(each.getBoundingClientRect()))")

    plan = "document.querySelector('#plan')"
    shown = f"(({{ clientHeight, scrollHeight }}) => scrollHeight <= clientHeight + 1)({plan})"
    say("Short.")
    panel.until("document.querySelector('#plan + .more').hidden")
    say("A reason that takes many words. " * 20)
    panel.until("!document.querySelector('#plan + .more').hidden")
    assert not panel.page.run(shown)
    before = places()
    panel.page.click("#plan + .more")
    panel.until(shown)
    assert places() == before
    panel.page.click("#plan + .more")
    panel.until(f"!{shown}")
    panel.page.click("#plan + .more")
    say("Short.")
    panel.until("document.querySelector('#plan + .more').hidden && !document.querySelector('[data-whole]')")
    panel.page.run("cobotPanel.motions.discard()")


def test_a_button_that_cannot_work_has_the_reason_as_its_tooltip(panel: Panel) -> None:
    panel.until("document.querySelector('#end').disabled")
    disabled = "'#dock button:disabled, #position-forget:disabled, #part-tool button:disabled'"
    titles = f"[...document.querySelectorAll({disabled})].map((each) => [each.id, each.title])"
    reasons = dict(panel.page.run(titles))
    assert {"execute", "rehearse", "discard", "pause", "end", "step", "tip-set"} <= set(reasons)
    assert all(reasons.values()), reasons
    panel.page.click('[data-position="work"]')
    panel.until("!document.querySelector('#execute').disabled")
    assert panel.page.run("document.querySelector('#execute').title") == ""
    panel.page.click("#discard")
    set_to(panel, "#language", "de")
    assert panel.page.run("document.querySelector('#execute').title") == "Zuerst eine Bewegung planen."
    set_to(panel, "#language", "en")


@pytest.mark.parametrize(
    ("language", "reach", "limit"),
    [
        ("en", "The arm does not reach the place", "is beyond the limit of"),
        ("de", "Der Arm erreicht die Stelle nicht", "liegt jenseits der Grenze von"),
        ("zh", "机械臂够不到该位置", "超出限值"),
    ],
)
def test_a_refused_plan_is_explained_in_the_language_of_the_panel(
    panel: Panel, language: str, reach: str, limit: str
) -> None:
    """Oracle: the numbers of `explain` in the answer of REST, in the units of the panel."""
    set_to(panel, "#language", language)
    try:
        for body, path, text in (
            ({"x": 3.0, "y": 0.0, "z": 0.5, "a": 0.0, "b": 3.0, "c": 0.0, "planner": "lin"}, "pose", reach),
            ({"joints": [3.5, *HOME[1:]]}, "joints", limit),
        ):
            answer = httpx.post(f"{panel.run.url}/robot/plan/{path}", json=body, timeout=WAIT_S).json()
            check = answer["explain"]["checks"][0]
            call = {"pose": "toPose('x', $BODY)", "joints": "toJoints('x', $BODY.joints)"}[path]
            panel.page.run(f"cobotPanel.motions.{call.replace('$BODY', json.dumps(body))}")
            panel.until(f"document.querySelector('#plan').innerText.includes({json.dumps(text)})")
            shown = panel.text("#plan")
            scale = {"rad": 180.0 / np.pi, "m": 1000.0}[check["unit"]]
            assert f"{scale * check['value']:.0f}" in shown
            detail = panel.page.run("document.querySelector('#plan').title")
            assert check["unit"] in detail, "the sentence of the service, for engineers"
            assert detail not in shown
    finally:
        set_to(panel, "#language", "en")
        panel.page.run("cobotPanel.motions.discard()")

"""Reading the configuration again, on virtual time; tests/e2e/test_reload.py has the processes.

Oracle: the files, and the answers of the endpoints before and after.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from independent_models import LIMITS, SRDF
from virtual_service import VirtualService, virtual_service

from cobot.types import LoopMode

FOLDED = "".join(f'<joint name="joint{i}" value="{0.1 * i}"/>' for i in range(1, 8))


@pytest.fixture
def service(tmp_path: Path) -> Iterator[VirtualService]:
    (tmp_path / "limits.yaml").write_bytes(LIMITS.read_bytes())
    (tmp_path / "arm.srdf").write_bytes(SRDF.read_bytes())
    with virtual_service(tmp_path, more="web: {joint_limits: limits.yaml}\n") as made:
        text = made.config.read_text(encoding="utf-8")
        made.config.write_text(text.replace("robot: {", "robot: {srdf: arm.srdf, "), encoding="utf-8")
        assert made.post("/admin/reload").json() == {"taken_over": [], "needs_restart": []}
        yield made


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def limit(folder: Path, joint: str, key: str, value: float) -> None:
    content = yaml.safe_load((folder / "limits.yaml").read_text(encoding="utf-8"))
    content["joint_limits"][joint][key] = value
    (folder / "limits.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def names(service: VirtualService) -> list[str]:
    return [position["name"] for position in service.get("/robot/positions").json()]


def test_named_positions_are_taken_over_whole(service: VirtualService, tmp_path: Path) -> None:
    edit(
        tmp_path / "arm.srdf",
        "</robot>",
        f'<group_state name="in" group="iiwa_arm">{FOLDED}</group_state></robot>',
    )
    edit(tmp_path / "arm.srdf", 'name="work"', 'name="bench"')
    answer = service.post("/admin/reload").json()
    assert answer["taken_over"] == ["named positions: bench added, in added, work removed"]
    assert names(service) == ["home", "bench", "transport", "in"]
    assert service.post("/robot/move/named", {"name": "in", "speed": 1.0}).json()["success"]
    assert service.joints() == pytest.approx([0.1 * i for i in range(1, 8)], abs=1e-3)
    assert service.post("/robot/move/named", {"name": "work"}).status_code == 422


def test_hosts_and_origins_count_with_the_next_request(service: VirtualService) -> None:
    app = "https://app.example"
    called, foreign = {"Host": "cell7.example"}, {"Origin": app}
    preflight = foreign | {"Access-Control-Request-Method": "POST"}

    def statuses() -> list[int]:
        asked = (("GET", called), ("GET", foreign), ("OPTIONS", preflight))
        return [service.ask(method, "/health", headers=headers).status_code for method, headers in asked]

    assert statuses() == [421, 403, 403]
    edit(service.config, "web: {", f"web: {{allowed_hosts: [cell7.example], allowed_origins: ['{app}'], ")
    assert service.post("/admin/reload").json() == {
        "taken_over": [
            "web.allowed_hosts: [] → ['cell7.example']",
            f"web.allowed_origins: [] → ['{app}']",
        ],
        "needs_restart": [],
    }
    assert statuses() == [200, 200, 200]
    answer = service.ask("GET", "/health", headers=foreign)
    assert answer.headers["Access-Control-Allow-Origin"] == app
    edit(service.config, "allowed_hosts: [cell7.example], ", "")
    edit(service.config, f"allowed_origins: ['{app}'], ", "")
    service.post("/admin/reload").raise_for_status()
    assert statuses() == [421, 403, 403]


def test_web_settings_count_with_the_next_request(service: VirtualService) -> None:
    body = {"joints": [0.0] * 7, "name": "x" * 2000}
    assert service.post("/robot/move/joints", body).status_code == 422
    edit(service.config, "web: {", "web: {max_json_bytes: 1500, stop_on_disconnect: false, port: 9, ")
    answer = service.post("/admin/reload").json()
    assert answer["taken_over"] == [
        "web.max_json_bytes: 2097152 → 1500",
        "web.stop_on_disconnect: True → False",
    ]
    assert answer["needs_restart"] == ["web.port: 8007 → 9"]
    assert service.post("/robot/move/joints", body).status_code == 413


def test_without_a_supervisor_limits_need_a_restart_and_nothing_goes_by_them(
    service: VirtualService, tmp_path: Path
) -> None:
    limit(tmp_path, "joint1", "max_velocity", 0.5)
    answer = service.post("/admin/reload").json()
    assert answer == {"taken_over": [], "needs_restart": ["joint1.max_velocity: 1.4835 → 0.5"]}
    robot = service.app.state.services.robot
    assert robot.limits.max_velocity[0] == 1.4835


def test_what_needs_a_restart_is_said_with_what_it_was_and_will_be(service: VirtualService) -> None:
    with service.config.open("a", encoding="utf-8") as file:
        file.write("rt: {cpu: 1}\nsequences: {log_lines: 20}\n")
    edit(service.config, "planning: {", "planning: {workers: 3, ")
    edit(service.config, "sequences: {recordings: recordings, programs: programs}\n", "")
    answer = service.post("/admin/reload").json()
    assert answer["taken_over"] == []
    changes = "\n".join(answer["needs_restart"])
    for change in ("rt.cpu: None → 1", "planning.workers: 2 → 3", "sequences.log_lines: 2000 → 20"):
        assert change in changes


def test_a_reload_refuses_the_endpoints_that_a_start_would_refuse(
    service: VirtualService, tmp_path: Path
) -> None:
    (tmp_path / "endpoints.yaml").write_text(
        "endpoints: {'POST /robots/{robot}/execute': {enabled: false}}\n"
    )
    edit(service.config, "web: {", "web: {endpoints: endpoints.yaml, ")
    answer = service.post("/admin/reload")
    assert answer.status_code == 422
    assert "below /robots/NAME have no separate entries" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("arm.srdf", "</robot>", "", "arm.srdf: not a readable SRDF"),
        (
            "arm.srdf",
            'joint name="joint3"',
            'joint name="joint9"',
            "arm.srdf: position 'home': joint",
        ),
        (
            "limits.yaml",
            "has_jerk_limits: true",
            "has_jerk_limits: false",
            "joint1.has_jerk_limits: must",
        ),
        ("limits.yaml", "joint7:", "joint8:", "the limits have joint1, joint2"),
        ("mine", "web: {", "web: {max_body_bytes: 1, ", ".yaml: web.max_body_bytes: "),
        ("mine", "web: {", "wbe: {", ".yaml: unknown key 'wbe' (did you mean 'web'?)"),
        ("mine", "web: {", "web: {endpoints: no.yaml, ", "no.yaml: no such file"),
    ],
)
def test_one_invalid_file_is_enough_to_change_nothing(
    service: VirtualService, tmp_path: Path, name: str, old: str, new: str, message: str
) -> None:
    edit(tmp_path / "arm.srdf", 'name="work"', 'name="bench"')
    file = service.config if name == "mine" else tmp_path / name
    edit(file, old, new)
    answer = service.post("/admin/reload")
    assert (answer.status_code, answer.json()["code"]) == (422, "input")
    assert message in answer.json()["detail"]
    assert names(service) == ["home", "work", "transport"]


def test_a_position_beyond_the_limits_is_no_valid_configuration(
    service: VirtualService, tmp_path: Path
) -> None:
    limit(tmp_path, "joint2", "max_position", 0.01)
    answer = service.post("/admin/reload")
    assert answer.status_code == 422
    assert "position 'work': the angle of joint2 is" in answer.json()["detail"]


def test_only_one_reload_at_a_time_and_none_while_something_moves(service: VirtualService) -> None:
    first = service.begin(service.asking("POST", "/admin/reload"))
    second = service.begin(service.asking("POST", "/admin/reload"))
    assert {service.end(first).status_code, service.end(second).status_code} <= {200, 409}
    move = service.begin(service.asking("POST", "/robot/move/named", json={"name": "work", "speed": 0.1}))
    service.sleep(0.5)
    refused = service.post("/admin/reload")
    assert refused.status_code == 409
    assert "in use by POST /robot/move/named" in refused.json()["detail"]
    assert service.end(move).json()["success"]


def test_an_arm_that_slows_down_after_an_estop_still_moves(service: VirtualService) -> None:
    service.begin(service.asking("POST", "/robot/move/named", json={"name": "transport", "speed": 1.0}))
    service.sleep(0.8)
    service.rig.request("estops")
    service.until(lambda: service.rig.mode is LoopMode.ESTOP)
    refused = service.post("/admin/reload")
    assert refused.status_code == 409
    service.sleep(3.0)
    assert service.post("/admin/reload").status_code == 200  # at rest: also in ESTOP
    service.post("/robot/reset")


def test_who_cannot_know_that_the_arm_rests_does_not_reload(service: VirtualService) -> None:
    service.cycles[service.name].stopped = True
    service.sleep(1.0)
    assert service.post("/admin/reload").status_code == 503
    service.cycles[service.name].stopped = False


def test_a_signal_has_its_answer_in_the_log(service: VirtualService, tmp_path: Path) -> None:
    async def hang_up() -> None:
        service.app.state.reloading.begin()
        await asyncio.sleep(1.0)

    edit(tmp_path / "arm.srdf", 'name="work"', 'name="bench"')
    service.run(hang_up())
    assert "INFO reload: applied: named positions: bench added, work removed" in service.output
    edit(service.config, "web: {", "web: {port: x, ")
    service.run(hang_up())
    assert "ERROR reload rejected: " in service.output
    assert "web.port: " in service.output


def test_live_and_ready_are_two_things(service: VirtualService) -> None:
    assert service.get("/health/live").json() == {"status": "live"}
    assert service.get("/health/ready").json() == {"status": "ready", "robots": [service.name]}
    service.rig.request("estops")
    service.sleep(0.1)
    ready = service.get("/health/ready")
    assert (ready.status_code, ready.json()["code"]) == (503, "not_ready")
    assert ready.json()["detail"].startswith(f"{service.name}: mode ESTOP: ")
    assert service.get(f"/robots/{service.name}/health/ready").status_code == 503
    assert service.get("/health/live").status_code == 200
    service.post("/robot/reset")
    service.app.state.services.planning.warm = False
    assert "planning processes are starting" in service.get("/health/ready").json()["detail"]
    service.app.state.services.planning.warm = True
    service.cycles[service.name].stopped = True
    service.sleep(1.0)
    assert "has published nothing for 1." in service.get("/health/ready").json()["detail"]
    service.cycles[service.name].stopped = False
    service.sleep(0.5)
    assert service.get("/health/ready").status_code == 200

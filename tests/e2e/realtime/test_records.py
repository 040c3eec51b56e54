"""What stays of a motion: its recording, which is replayed, and its job, which is interrupted by kill -9.

Oracles: the library `mcap`, which reads the file, with `rosbags` for its messages; where the arm is.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from arm_activities import child, robot_health
from cobot_run import WAIT_S, Run
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cobot.launch.cli import main

THERE, BACK = [0.4, 0.3, 0.0, -1.3, 0.0, 1.4, 0.0], [-0.2, 0.1, 0.1, -1.5, 0.0, 1.5, 0.3]


def asked(run: Run, method: str, path: str, **content: Any) -> Any:
    return httpx.request(method, f"{run.url}{path}", timeout=WAIT_S, **content).raise_for_status().json()


def move(run: Run, joints: list[float], speed: float = 1.0, wait: bool = True) -> Any:
    body = {"joints": joints, "speed": speed}
    return asked(run, "POST", f"/robot/move/joints?wait={str(wait).lower()}", json=body)


def read(path: Path) -> dict[str, list[Any]]:
    """The messages of a recording by topic."""
    store, found = get_typestore(Stores.EMPTY), dict[str, list[Any]]()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if schema.name not in store.fielddefs:
                types = get_types_from_msg(schema.data.decode(), schema.name)
                store.register({name: each for name, each in types.items() if name not in store.fielddefs})
            found.setdefault(channel.topic, []).append(store.deserialize_cdr(message.data, schema.name))
    return found


def test_a_recorded_motion_is_replayed(
    service: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def cobot(*arguments: str) -> str:
        assert main([*arguments, "--url", service.url]) == 0, capsys.readouterr()
        return capsys.readouterr().out

    service.go_home()
    cobot("record", "start")
    for goal in (THERE, BACK):
        assert move(service, goal)["success"]
    path = Path(cobot("record", "stop", "--output", str(tmp_path)).strip())
    recorded = read(path)
    told = [(event.kind, event.text.split()[-1]) for event in recorded["/events"] if event.kind == "motion"]
    assert told == [("motion", "begun"), ("motion", "arrived")] * 2
    assert set(np.diff([each.cycle for each in recorded["/cycle"]])) == {1}
    end = recorded["/commanded"][-1].position
    np.testing.assert_allclose(end, BACK, atol=1e-6)
    service.go_home()
    said = cobot("replay", str(path), "--move-to-start")
    assert "points" in said
    job = service.until(lambda: (job := asked(service, "GET", "/jobs?n=1")["jobs"][0])["ended_at"] and job)
    assert (job["kind"], job["state"]) == ("trajectory", "finished"), job
    np.testing.assert_allclose(service.joints(), end, atol=2e-3)
    again = Path(cobot("record", "dump", "--seconds", "10", "--output", str(tmp_path)).strip())
    turned = np.array([each.position for each in read(again)["/commanded"]])
    assert np.abs(turned - THERE).max(axis=1).min() < 2e-3, "it did not go by way of the first goal"


@pytest.mark.thorough
def test_a_job_whose_service_is_killed_is_interrupted_and_stays_so(service: Run) -> None:
    service.go_home()
    job = move(service, [2.0, 0.3, 0.0, -1.3, 0.0, 1.4, 0.0], speed=0.1, wait=False)
    service.until(lambda: service.joints()[0] > 0.1)
    killed = child(service, "app", None)
    os.kill(killed.pid, signal.SIGKILL)
    service.until(lambda: service.restarted("app", killed.pid) and service.healthy())
    found = asked(service, "GET", f"/jobs/{job['id']}")
    assert found["state"] == "interrupted"
    assert "service" in found["error"]["detail"]
    assert found["id"] in [each["id"] for each in asked(service, "GET", "/jobs?state=interrupted")["jobs"]]
    service.until(lambda: robot_health(service).get("mode") == "HOLD" and robot_health(service)["settled"])
    at_rest = service.joints()
    assert at_rest[0] < 1.9
    refused = httpx.post(f"{service.url}/jobs/{job['id']}/resume", timeout=WAIT_S)
    assert refused.status_code == 409
    assert move(service, at_rest, 1.0)["success"]
    np.testing.assert_allclose(service.joints(), at_rest, atol=2e-3)

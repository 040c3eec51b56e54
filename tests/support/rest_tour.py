"""The whole REST tour of an arm that may be any: every kind of motion, trajectories, a sequence, plans, jobs,
positions, tool, scene, control and a recording. Everything is relative to the position `work` of its SRDF.

Oracle: where the service says that the arm is afterwards.
"""

from __future__ import annotations

import csv
import io
import json
from typing import Any

import httpx
import numpy as np
from cobot_run import WAIT_S, Run, again, until

SPEED = 1.0
REACHED_RAD, REACHED_M = 5e-3, 5e-3


class Tour:
    """A client that does again what a busy computer has stopped, as its user would."""

    def __init__(self, run: Run, http: httpx.Client) -> None:
        self._run, self._http = run, http
        names = {each["name"]: each["joints"] for each in self.get("/robot/positions")}
        self.home, self.work = names["home"], names["work"]

    def get(self, path: str) -> Any:
        return self._http.get(path).raise_for_status().json()

    def post(self, path: str, body: Any = None, **more: Any) -> Any:
        answers: list[httpx.Response] = []

        def asked() -> tuple[bool, str]:
            answers.append(self._http.post(path, json=body, **more))
            return answers[-1].is_success, f"{path}: {answers[-1].text}"

        again(asked)
        return answers[-1].json()

    def paused(self, job: str) -> bool:
        """Whether it is; on a fast clock it may have ended before it could."""
        answer = self._http.post(f"{job}/pause")
        assert answer.is_success or "has already ended" in answer.text, answer.text
        return answer.is_success

    def move(self, path: str, **body: Any) -> None:
        """A motion that arrives."""

        def asked() -> tuple[bool, str]:
            answer = self.post(f"/robot/move/{path}", body if "motions" in body else {"speed": SPEED, **body})
            return answer["success"], answer["message"]

        again(asked)

    def go_to_work(self) -> None:
        self.move("named", name="work")

    def near(self, joints: list[float]) -> None:
        np.testing.assert_allclose(self._run.joints(), joints, atol=REACHED_RAD)

    def pose(self, **offset: float) -> dict[str, float]:
        """Of the TCP, moved by so much."""
        found = self.get("/robot/pose")
        pose = {**found["position"], **found["orientation"]["euler_rad"]}
        return {name: value + offset.get(name, 0.0) for name, value in pose.items()}

    def at(self, pose: dict[str, float]) -> None:
        here = self.get("/robot/pose")["position"]
        np.testing.assert_allclose([here[k] for k in "xyz"], [pose[k] for k in "xyz"], atol=REACHED_M)

    def beside(self, share: float) -> list[float]:
        """From `work` to `home`, so far."""
        return list((1.0 - share) * np.array(self.work) + share * np.array(self.home))

    def until_ended(self, motion: int) -> str:
        """What the log says became of it."""
        words = f"motion {motion}: "

        def said() -> str:
            lines = [str(each) for each in self.get("/trajectory/logs?n=50")["lines"]]
            return next((line for line in lines if words in line and "accepted" not in line), "")

        return str(until(said))


def motions(tour: Tour) -> None:
    """Each kind, and several as one."""
    tour.move("named", name="home")
    tour.near(tour.home)
    tour.move("joints", joints=tour.beside(0.2))
    tour.near(tour.beside(0.2))
    tour.go_to_work()
    work, above = tour.pose(), tour.pose(z=0.05)
    for planner, there in (("ptp", above), ("lin", work), ("ompl", above)):
        tour.move("pose", planner=planner, **there)
        tour.at(there)
    via, there = tour.pose(y=0.03, z=-0.03), tour.pose(y=0.06)
    tour.move("pose", planner="circ", via={name: via[name] for name in "xyz"}, **there)
    tour.at(there)
    centre = tour.pose(y=-0.03)
    tour.move("arc", centre={k: centre[k] for k in "xyz"}, axis={"x": 0.0, "y": 0.0, "z": 1.0}, angle=3.1)
    both = [{"joints": tour.beside(0.1), "speed": SPEED}, {"name": "work", "speed": SPEED}]
    tour.move("sequence", motions=both, radii=[0.02])
    tour.near(tour.work)


def plans(tour: Tour) -> None:
    """Made without moving, run as it was made."""

    def executed() -> tuple[bool, str]:
        tour.go_to_work()
        made = tour.post("/robot/plan/joints", {"joints": tour.beside(0.2), "speed": SPEED})
        done = tour.post("/robot/execute", {"plan_id": made["plan_id"]})
        return done["success"], done["message"]

    again(executed)
    tour.near(tour.beside(0.2))


def trajectories(tour: Tour) -> None:
    """Points as JSON and as CSV."""
    points = [(0.0, tour.work), (1.5, tour.beside(0.1)), (3.0, tour.work)]
    table = io.StringIO()
    writer = csv.writer(table)
    writer.writerow([f"joint{n}" for n in range(1, len(tour.work) + 1)] + ["t"])
    writer.writerows([*joints, time_s] for time_s, joints in points)
    timed = [{"positions": joints, "time_from_start": time_s} for time_s, joints in points]
    for request in (
        {"path": "/trajectory/send", "body": {"points": timed, "move_to_start": True}},
        {
            "path": "/trajectory/send_csv?separator=%2C&move_to_start=true",
            "files": {"file": ("points.csv", table.getvalue())},
        },
    ):

        def sent(request: dict[str, Any] = request) -> tuple[bool, str]:
            tour.go_to_work()
            ended = tour.until_ended(tour.post(**request)["motion_id"])
            return "arrived" in ended, ended

        again(sent)
        tour.near(tour.work)


def programs(tour: Tour) -> None:
    """A sequence, in a process of its own."""
    waypoints = [{"joints": tour.beside(0.1), "speed": SPEED}, {"named": "work", "speed": SPEED}]
    file = {"config": ("tour.json", json.dumps({"waypoints": waypoints}))}

    def run() -> tuple[bool, str]:
        tour.post("/sequences/start", files=file, data={"n_iterations": "1"})
        ended = until(
            lambda: found if (found := tour.get("/sequences/status"))["status"] == "finished" else None
        )
        return ended["returncode"] == 0, str(tour.get("/sequences/logs?n=50")["lines"])

    again(run)


def jobs(tour: Tour) -> None:
    """Begun without waiting, at half the speed, paused and resumed."""

    def done() -> tuple[bool, str]:
        tour.go_to_work()
        job = tour.post("/robot/move/joints?wait=false", {"joints": tour.beside(0.3), "speed": SPEED})
        path = f"/jobs/{job['id']}"
        until(lambda: tour.get(path)["state"] != "planning")
        if tour.get(path)["state"] == "running" and tour.paused(path):
            tour.post(f"{path}/resume")
        ended = until(lambda: found if (found := tour.get(f"{path}?wait_s=30"))["ended_at"] else None)
        return ended["state"] == "finished", str(ended["error"])

    assert tour.post("/robot/speed_override", {"fraction": 0.5})["fraction"] == 0.5
    try:
        again(done)
    finally:
        tour.post("/robot/speed_override", {"fraction": 1.0})
    tour.near(tour.beside(0.3))


def everything_else(tour: Tour) -> None:
    """Positions, control, a recording, how it is."""
    tour.post("/robot/positions", {"name": "taught", "joints": tour.beside(0.2)})
    tour.move("named", name="taught")
    tour.near(tour.beside(0.2))
    assert len(tour.get("/robot/joint_states")["name"]) == len(tour.home)
    assert tour.get("/robot/tool")
    assert tour.get("/scene")
    until(lambda: tour.get("/recordings")["recorder"]["alive"])
    (name,) = tour.post("/recordings", {"action": "dump", "seconds": 0.5})["names"]
    assert name in [each["name"] for each in tour.get("/recordings")["recordings"]]
    assert tour.post("/stop")["success"]
    assert tour.get("/health")["status"] == "ok"


PARTS = {part.__name__: part for part in (motions, plans, trajectories, programs, jobs, everything_else)}


def tour(run: Run, *parts: str) -> None:
    """These of `PARTS`."""
    with httpx.Client(base_url=run.url, timeout=WAIT_S) as http:
        for part in parts:
            PARTS[part](Tour(run, http))

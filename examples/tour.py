"""The ten-minute tour with httpx2. Start `make run` in another terminal, then:

.venv/bin/python examples/tour.py
"""

from __future__ import annotations

import os
import re
import time
from pathlib import Path

import httpx2

URL = os.environ.get("COBOT_URL", "http://localhost:8007")
HERE = Path(__file__).parent
T_READ, T_STOP, T_MOVE = 10, 15, 90
http = httpx2.Client(base_url=URL, trust_env=False)  # requests to the robot do not use a proxy


def read(path: str) -> dict:
    response = http.get(path, timeout=T_READ)
    response.raise_for_status()
    return response.json()


def move(path: str, body: dict) -> None:
    """Move the arm. If a motion fails, the status is still 200, so check `success` too."""
    response = http.post(path, json=body, timeout=T_MOVE)
    response.raise_for_status()
    answer = response.json()
    if not answer["success"]:
        raise RuntimeError(answer["message"])
    print(path, answer)


def wait_for(path: str, pattern: str) -> str:
    """Read a path until the response matches the pattern, and return the match."""
    for _ in range(450):
        found = re.search(pattern, http.get(path, timeout=T_READ).text)
        if found:
            return found.group()
        time.sleep(0.2)
    raise TimeoutError(f"{path} has no {pattern}")


# 1. Where is the arm? Angles in rad, velocities in rad/s, efforts in N·m
state = read("/robot/joint_states")
print(dict(zip(state["name"], state["position"], strict=True)))

# 2. Where is the TCP? Metres in base_link, and the KUKA angles A, B, C
pose = read("/robot/pose")
print(pose["position"], pose["orientation"]["euler_deg"])

# 3. Which positions have names?
for position in read("/robot/positions"):
    print(position["name"], "-", position["description"])

# 4. Go home, at half speed. The response is sent when the arm has arrived
move("/robot/move/named", {"name": "home", "speed": 0.5})

# 5. Move the joints
move("/robot/move/joints", {"joints": [0.0, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], "speed": 0.5})

# 6. Move the TCP: first to a point, then down a straight line, then along an arc
down = {"b": 3.14159, "speed": 0.5}
via = {"x": 0.5, "y": 0.1, "z": 0.45}
move("/robot/move/pose", {"x": 0.45, "y": 0.0, "z": 0.55, **down})
move("/robot/move/pose", {"x": 0.45, "y": 0.0, "z": 0.45, **down, "planner": "lin"})
move("/robot/move/pose", {"x": 0.45, "y": 0.2, "z": 0.45, **down, "planner": "circ", "via": via})

# 7. Impossible motions: the response gives the reason, and nothing moves
too_far = http.post("/robot/move/pose", json={"x": 3.0, "y": 0.0, "z": 0.5}, timeout=T_MOVE).json()
print(too_far["success"], too_far["message"])
beyond = http.post("/robot/move/joints", json={"joints": [9, 0, 0, 0, 0, 0, 0]}, timeout=T_MOVE)
print(beyond.status_code, beyond.json()["detail"])

# 8. Send your own trajectory, as JSON and as CSV. It runs while you read the log
move("/robot/move/named", {"name": "home", "speed": 0.5})
home = [0, 0, 0, -1.57, 0, 1.57, 0]
points = [
    {"positions": home, "time_from_start": 0.0},
    {"positions": [0, 0.3, 0, -1.2, 0, 1.3, 0], "time_from_start": 2.0},
    {"positions": home, "time_from_start": 4.0},
]
sent = http.post("/trajectory/send", json={"points": points}, timeout=T_MOVE)
sent.raise_for_status()
print(sent.json())
ended = wait_for("/trajectory/logs?n=5", f'motion {sent.json()["motion_id"]}: (arrived|[^a])[^"]*')
print(ended)
assert "arrived" in ended, ended
with (HERE / "trajectory.csv").open("rb") as csv_file:
    uploaded = http.post(
        "/trajectory/send_csv",
        params={"separator": ",", "retime": True},
        files={"file": ("trajectory.csv", csv_file, "text/csv")},
        timeout=T_MOVE,
    )
uploaded.raise_for_status()
print(uploaded.json())

# 9. Stop: the arm stops on its path
print(http.post("/stop", timeout=T_STOP).json()["message"])

# 10. Run a sequence, in its own process
with (HERE / "motion_sequence_config.json").open("rb") as sequence:
    started = http.post(
        "/sequences/start",
        files={"config": ("motion_sequence_config.json", sequence, "application/json")},
        data={"n_iterations": "1", "delay_between_iterations": "0"},
        timeout=T_READ,
    )
started.raise_for_status()
wait_for("/sequences/status", '"finished"')
print(*read("/sequences/logs?n=20")["lines"], sep="\n")
status = read("/sequences/status")
print(status)
assert status["returncode"] == 0, "the sequence has failed"

# What is the state of the robot?
print(read("/health")["status"])

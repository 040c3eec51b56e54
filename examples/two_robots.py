"""Moves all robots of a service at the same time. In two terminals:

.venv/bin/cobot run --config examples/two_robots.yaml
.venv/bin/python examples/two_robots.py
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import httpx2

from cobot.client import Client

URL = os.environ.get("COBOT_URL", "http://localhost:8007")


def there_and_back(name: str) -> str:
    """Move a robot there and back. Each robot has its own client, planner and process, so no robot waits for
    another.
    """
    with Client(URL, robot=name) as robot:
        there = robot.move_named("work", speed=0.5)
        back = robot.move_named("home", speed=0.5)
    return f"{name}: there in {there['duration_s']:.1f} s, back in {back['duration_s']:.1f} s"


names = [robot["name"] for robot in httpx2.get(f"{URL}/robots", trust_env=False).json()]
with ThreadPoolExecutor(len(names)) as threads:
    for line in threads.map(there_and_back, names):
        print(line)

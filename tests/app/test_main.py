"""How the application is put together: what its documentation says, and needs.

Oracle: joint_limits.yaml as read by PyYAML; httpx as the client, without a network.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from asgi_client import ask

from app.main import create_app
from cobot.config import Settings

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture(scope="module")
def schema(settings: Settings) -> dict[str, Any]:
    return create_app(settings, None, "http://robot.test").openapi()


def test_the_limits_of_the_file_stand_in_the_schema(schema: dict[str, Any]) -> None:
    limits = yaml.safe_load((CONFIG / "joint_limits.yaml").read_text(encoding="utf-8"))["joint_limits"]
    for model, field in (("MoveJoints", "joints"), ("TrajectoryPoint", "positions")):
        items = schema["components"]["schemas"][model]["properties"][field]["prefixItems"]
        assert [(item["minimum"], item["maximum"]) for item in items] == [
            (joint["min_position"], joint["max_position"]) for joint in limits.values()
        ]


def test_the_documentation_needs_nobody_else(settings: Settings) -> None:
    app = create_app(settings, None, "http://robot.test")
    for page in ("/docs", "/docs/robots", "/docs/vendor", "/redoc"):
        text = ask(app, "GET", page).text
        addresses = re.findall(r'(?:src|href)="([^"]+)"', text)
        assert len(addresses) >= 2
        for address in addresses:
            assert address.startswith("/"), "everything comes from this service"
            if address != "/manual/":  # it may not be built here: tests/e2e/test_manual.py
                assert ask(app, "GET", address).status_code == 200
        assert not re.findall(r"https?://(?!robot\.test)[^\"' ]+", text)

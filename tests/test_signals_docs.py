"""docs/signals-and-contact.md: each of its examples runs against the service, on virtual time."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from wired_arm import WiredService

PAGE = Path(__file__).parents[1] / "docs" / "signals-and-contact.md"
TABLE_Z = 0.5


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)


@pytest.fixture
def service(tmp_path: Path) -> WiredService:
    return WiredService(tmp_path)


def test_each_example_of_the_page_does_what_the_page_says(service: WiredService) -> None:
    with service.serving() as run:
        assert run is service
        service.arm.inputs["part"] = 1.0
        tcp = service.rig.memory.state.data["tcp"]

        def table() -> None:
            service.arm.push[2] = max(0.0, 20_000.0 * (TABLE_Z - float(tcp[2])))

        answers = []
        for block in blocks("http"):
            head, _, body = block.partition("\n")
            method, path = head.split()
            request = json.loads(body) if body.strip() else None
            touches = request is not None and "until" in request
            service.cycles[service.name].watch = table if touches else lambda: None
            answer = service.ask(method, path, json=request)
            assert answer.status_code == 200, answer.text
            answers.append(answer.json())
            service.arm.push[:] = np.zeros(6)
        assert [answer["success"] for answer in answers] == [True] * 6
        glue = [each.value for each in service.arm.set if each.name == "glue"]
        assert glue == [1.0, 0.0]
        assert all(each["fired"] for each in answers[1]["actions"])
        contact = answers[4]["contact"]
        assert contact["force"][2] > 15.0
        assert abs(contact["position"][2] - TABLE_Z) < 0.003
        names = {"robot": service.client(service.url), "print": lambda *said: None}
        service.cycles[service.name].watch = lambda: None
        for block in blocks("python"):
            exec(block, names)  # the page is ours
        assert names["answer"]["stopped_by"] is None
        assert names["answer"]["actions"][0]["fired"]

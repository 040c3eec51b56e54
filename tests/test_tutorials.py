"""The tutorial's Python, block by block, beside a service on virtual time."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from virtual_service import virtual_service

from cobot import client

PAGE = Path(__file__).parents[1] / "docs" / "tutorial-python.md"


def test_each_block_of_the_python_tutorial_does_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = re.findall(r"^```python\n(.*?)\n```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    assert len(blocks) >= 6
    with virtual_service(tmp_path) as service:
        monkeypatch.setattr(client, "Client", lambda url: service.client(service.url))
        names: dict[str, Any] = {}
        for block in blocks[:-1]:
            exec(compile(block, str(PAGE), "exec"), names)
        service.until(lambda: service.rig.mode.name == "HOLD")
        np.testing.assert_allclose(service.joints(), [0, 0, 0, -1.57, 0, 1.57, 0], atol=2e-3)
    said = capsys.readouterr().out
    assert "home" in said
    assert "joint angle of joint1 is 9 rad" in said

"""Trace, SystemInfo and RobotManage where no arm is needed.

Oracles: the standard library's json, time, hashlib and importlib.metadata.
"""

from __future__ import annotations

import hashlib
import json
import logging
import time
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

import pytest
from vendor_calls import Caller, equipped, run

import cobot
from app.services.devices.traces import CAPACITY
from cobot.codes import Code


def test_messages_are_kept_in_order_and_logged(caplog: pytest.LogCaptureFixture) -> None:
    async def check() -> None:
        ask = Caller(equipped(), "Trace")
        with caplog.at_level(logging.INFO, "cobot.trace"):
            await ask("textmsg", msg="one")
            await ask("notify", msg="two")
            await ask("alarm", level=2, code=17, args=["axis 3", "hot"])
            await ask("popup", level=1, title="Door", msg="is open", mode=0)
        assert [record.message for record in caplog.records] == ["one", "two", "axis 3, hot", "Door: is open"]
        assert [record.levelname for record in caplog.records] == ["INFO", "INFO", "ERROR", "WARNING"]
        found = json.loads(await ask("peek", num=10))
        assert [(m["number"], m["kind"], m["level"], m["code"], m["title"], m["text"]) for m in found] == [
            (1, "text", "info", 0, "", "one"),
            (2, "notify", "info", 0, "", "two"),
            (3, "alarm", "error", 17, "", "axis 3, hot"),
            (4, "popup", "warning", 0, "Door", "is open"),
        ]
        assert abs(datetime.fromisoformat(found[0]["time"]).timestamp() - time.time()) < 600.0
        assert [m["number"] for m in json.loads(await ask("peek", num=10, last_number=3))] == [4]
        assert [m["number"] for m in json.loads(await ask("peek", num=1))] == [4]

    run(check())


def test_only_so_many_messages_are_kept_and_none_is_endless() -> None:
    async def check() -> None:
        robot = equipped()
        ask = Caller(robot, "Trace")
        for number in range(CAPACITY + 10):
            robot.equipment.traces.add("text", str(number))
        await ask("textmsg", msg="x" * 100_000)
        found = json.loads(await ask("peek", num=10**6))
        assert len(found) == CAPACITY
        assert found[0]["text"] == "11"
        assert len(found[-1]["text"]) == 10_000

    run(check())


def test_wrong_messages_are_refused() -> None:
    async def check() -> None:
        ask = Caller(equipped(), "Trace")
        assert "valid values: 0 info" in await ask.fails("alarm", Code.INPUT, level=4, code=1, args=[])
        await ask.fails("popup", Code.INPUT, level=0, title="", msg="", mode=1)
        await ask.fails("peek", Code.INPUT, num=0)

    run(check())


def test_versions_and_times_are_the_real_ones() -> None:
    async def check() -> None:
        ask = Caller(equipped(), "SystemInfo")
        assert await ask("getControlSoftwareFullVersion") == version("cobot")
        major, minor, patch = (int(part) for part in version("cobot").split("."))
        code = major * 10**6 + minor * 10**3 + patch
        assert await ask("getControlSoftwareVersionCode") == code
        assert await ask("getInterfaceVersionCode") == code
        before = time.time_ns()
        assert before <= await ask("getControlSystemTime") <= time.time_ns()
        root = Path(cobot.__file__).parents[1]
        files = sorted(file for name in ("app", "cobot", "rtloop") for file in (root / name).rglob("*.py"))
        content = b"".join(file.read_bytes() for file in files)
        assert await ask("getControlSoftwareVersionHash") == hashlib.sha256(content).hexdigest()[:16]
        newest = max(file.stat().st_mtime for file in files)
        built = datetime.fromisoformat(await ask("getControlSoftwareBuildDate"))
        assert abs(built.timestamp() - newest) < 1.0
        assert (await ask("getPlatform")).startswith("Python 3.")

    run(check())


def test_what_this_product_has_not_is_said_not_pretended() -> None:
    async def check() -> None:
        ask = Caller(equipped(), "RobotManage")
        for method, fields in (
            ("poweroff", {}),
            ("lockRobotBrake", {}),
            ("backdrive", {"enable": True}),
            ("freedrive", {"enable": True}),
            ("setOperationalMode", {"mode": "Manual"}),
            ("setSim", {"enable": False}),
            ("startRecord", {"file": "x"}),
            ("stopRecord", {}),
        ):
            await ask.fails(method, Code.NOT_SUPPORTED, **fields)
        await ask("setOperationalMode", mode="Automatic")
        await ask("setSim", enable=True)
        assert await ask("isSimulationEnabled")
        assert not await ask("isFreedriveEnabled")
        assert not await ask("isBackdriveEnabled")

    run(check())

"""The device's status in answers. Oracle: the fields of `DeviceStatus`."""

from __future__ import annotations

from dataclasses import fields

from app.api.schemas.device import DeviceStatusAnswer
from cobot.robot.device import DeviceStatus


def test_an_answer_shows_each_field_of_a_device_status() -> None:
    assert list(DeviceStatusAnswer.model_fields) == [each.name for each in fields(DeviceStatus)]

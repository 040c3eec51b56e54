"""A sequence that is just being started: who asks for a stop meanwhile is told the truth."""

from __future__ import annotations

import asyncio

import pytest
from rig import Rig, no_tokens

from app.services.motion.ownership import Ownership
from app.services.programs.sequences import SequenceOrder, SequenceService
from app.services.state.link import RobotLink
from cobot.errors import UnavailableError

ORDER = SequenceOrder(b"{}", 1, 0.0, "", "", "", "")


def test_a_stop_names_a_start_that_is_under_way_and_a_failed_start_leaves_the_arm_free(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0)
    ownership = Ownership(link)
    service = SequenceService(ownership, link, rig.settings.sequences, "http://robot.test", 1.0, no_tokens())

    async def start() -> None:
        go_on = asyncio.Event()

        async def spawn(*_: object) -> None:
            await go_on.wait()
            raise OSError("no more processes")

        monkeypatch.setattr(service, "_spawn", spawn)
        starting = asyncio.create_task(service.start(ORDER, ownership.stops))
        await asyncio.sleep(0)
        assert await service.stop() == "the start of a sequence"
        assert ownership.owner == "sequence 1"
        go_on.set()
        with pytest.raises(UnavailableError, match="cannot be started: no more processes"):
            await starting

    asyncio.run(start())
    assert ownership.owner is None
    assert asyncio.run(service.stop()) is None
    link.close()

"""What is refused leaves nothing behind: a crowd of it, again and again, takes no memory.

Oracle: the interpreter's own count of the blocks of memory that are in use.
"""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Iterator
from contextlib import suppress

import pytest
from asgi_client import Refused
from virtual_service import VirtualService

FIRST, ROUNDS = 2, 3
NAMES = 20
MAX_BLOCKS = 2 * NAMES
"""In a round: far less than one for each of its requests, of which there are eleven for each name."""


def attack(service: VirtualService, round_: int) -> None:
    """Names and tokens are others each time, so that whatever keeps them keeps them all; of hosts and pages
    256 are remembered.
    """
    for number in range(NAMES):
        name = f"of-round-{round_}-{number}"
        for headers in (
            {"host": f"{number}.example"},
            {"origin": f"http://{number}.example"},
            {"authorization": f"Bearer {name}"},
            {"x-request-id": name},
        ):
            service.ask("GET", f"/{name}", headers=headers)
        service.ask("PROPFIND", f"/{name}")
        service.ask("GET", f"/jobs/{name}?wait_s=0")
        service.ask("GET", f"/recordings/{name}")
        service.ask("GET", f"/events?types={name}")
        service.ask("POST", "/robot/plan/named", json={"name": name})
        service.ask("POST", f"/{service.name}/RegisterControl/getBool", json={"key": name, name: 1})
        with suppress(Refused):
            service.connect(f"/foxglove?rate_hz={name}")


def blocks_in_use() -> int:
    gc.collect()
    return sys.getallocatedblocks()


@pytest.fixture
def unheard() -> Iterator[None]:
    """pytest and the rig keep each line of the log."""
    logging.disable()
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.usefixtures("unheard")
def test_what_is_refused_leaves_nothing_behind(service: VirtualService) -> None:
    for round_ in range(FIRST):  # also what is made at the first use only
        attack(service, round_)
    before = blocks_in_use()
    for round_ in range(FIRST, FIRST + ROUNDS):
        attack(service, round_)
    assert blocks_in_use() - before < ROUNDS * MAX_BLOCKS

"""The keys of a fleet on Zenoh.

    cobot/FLEET/CELL/ROBOT/state      the latest state of a robot: published, and the answer to a query
    cobot/FLEET/CELL/ROBOT/event      an event, when it happens
    cobot/FLEET/CELL/ROBOT/events     the last events: the answer to a query
    cobot/FLEET/CELL/ROBOT/command    a query with a command, such as a stop
    cobot/FLEET/CELL/ROBOT/programs   the stored programs: the answer to a query
    cobot/FLEET/CELL/ROBOT/recordings   the complete recordings: the answer to a query
    cobot/FLEET/CELL/ROBOT/recording    a piece of a recording, or its hash: the answer to a query
    cobot/FLEET/CELL/panel/request    a query with a request to the cell's panel
    cobot/FLEET/CELL/INSTANCE         the liveliness token of a cell's process
    cobot/FLEET/@hub/time             the time of the fleet: the answer to a query
    cobot/FLEET/@hub/bundles/HASH     the content of a bundle: the answer to a query
    cobot/FLEET/@hub/INSTANCE         the liveliness token of a hub

A chunk that begins with @ matches no wildcard, so the hub cannot be confused with a cell.
"""

from __future__ import annotations

import re
import socket
from dataclasses import dataclass

PREFIX = "cobot"
HUB = "@hub"
NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_-]+")


@dataclass(frozen=True, slots=True)
class FleetKeys:
    """The keys of one fleet. `*` as the name of a cell or robot means all of them."""

    fleet: str

    def of(self, cell: str, robot: str, last: str) -> str:
        return f"{PREFIX}/{self.fleet}/{cell}/{robot}/{last}"

    def alive(self, cell: str, instance: str) -> str:
        """The key of the liveliness token of a cell's process."""
        return f"{PREFIX}/{self.fleet}/{cell}/{instance}"

    def panel(self, cell: str) -> str:
        """The key for requests to the panel of a cell. It does not conflict with a robot named `panel`,
        because robots have no key `request`.
        """
        return self.of(cell, "panel", "request")

    @property
    def time(self) -> str:
        return f"{PREFIX}/{self.fleet}/{HUB}/time"

    def bundle(self, name: str) -> str:
        """The key of a bundle's content; `*` for all bundles."""
        return f"{PREFIX}/{self.fleet}/{HUB}/bundles/{name}"

    def hub(self, instance: str) -> str:
        """The key of the liveliness token of a hub."""
        return f"{PREFIX}/{self.fleet}/{HUB}/{instance}"


def parts(key: str) -> tuple[str, str]:
    """The names in a key: the cell, and the robot or the instance."""
    chunks = key.split("/")
    return chunks[2], chunks[3]


def own_cell_name(given: str | None) -> str:
    """The name of this cell in the settings. If they contain none, the name of this computer."""
    return given or NOT_IN_NAMES.sub("-", socket.gethostname())[:48].strip("-") or "cell"

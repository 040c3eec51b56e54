"""The first contact with hardware: slow until somebody has compared it with what rtloop has found."""

from __future__ import annotations

from app.services.state.link import RobotLink
from cobot.errors import InputError, UnavailableError


async def acknowledge_contact(link: RobotLink, *, payload_checked: bool) -> str:
    """Acknowledge it; what it has found, "" if there is nothing to acknowledge.

    Args:
        payload_checked: whether somebody has said that the model's own tool and load are those of the arm.

    Raises:
        InputError: nobody has said what the arm carries.
        UnavailableError: rtloop does not answer.
    """
    named = link.device()
    if named is None:
        raise UnavailableError("rtloop has not said yet what it drives")
    found = named[1].unacknowledged
    if not found:
        return ""
    if not payload_checked and not link.tool_version:
        raise InputError(
            "payload_checked: nobody has said what the arm carries: set tool and load by POST /robot/tool, "
            "or say true if the arm carries nothing that its model does not have"
        )
    await link.commands.acknowledge()
    return found

"""Acknowledges the first contact with hardware. The arm moves slowly until a person has checked rtloop's
findings.
"""

from __future__ import annotations

from app.services.state.link import RobotLink
from cobot.errors import InputError, UnavailableError


async def acknowledge_contact(link: RobotLink, *, payload_checked: bool) -> str:
    """Acknowledge the first contact. Returns its findings; "" if there is nothing to acknowledge.

    Args:
        payload_checked: whether the client confirms that the arm carries the tool and the load in the model.

    Raises:
        InputError: the tool and load of the arm are not confirmed.
        UnavailableError: rtloop does not answer.
    """
    named = link.device()
    if named is None:
        raise UnavailableError("the real-time loop has not reported its robot yet: try again in a second")
    found = named[1].unacknowledged
    if not found:
        return ""
    if not payload_checked and not link.tool_version:
        raise InputError(
            "payload_checked: the arm's tool and load are not confirmed; set them with POST "
            "/robot/tool, or send true if the arm carries nothing in addition to its model"
        )
    await link.commands.acknowledge()
    return found

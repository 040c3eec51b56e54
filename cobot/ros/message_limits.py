"""Limits for one rosbridge message. The service rejects larger messages, and the DDS process never sends
them.

While a message is decoded, no other code of the service can run, not even a stop. The limits bound this time.
"""

from __future__ import annotations

from cobot.errors import PayloadError

MAX_MESSAGE = 4 * 2**20
"""Maximum length of a message, in characters."""
MAX_OBJECTS = 30_000
"""Maximum number of objects in a message. ROS's defaults may make each of them a hundred times as large."""
MAX_VALUES = 200_000
"""Maximum number of commas in a message."""


def check_message(text: str) -> None:
    """Check the size of an encoded message.

    Raises:
        PayloadError: a limit is exceeded; the message gives the number and the limit.
    """
    if len(text) > MAX_MESSAGE:
        raise PayloadError(f"the message has {len(text)} characters, allowed: {MAX_MESSAGE}")
    if (objects := text.count("{")) > MAX_OBJECTS:
        raise PayloadError(f"the message has {objects} objects, allowed: {MAX_OBJECTS}")
    if (commas := text.count(",")) > MAX_VALUES:
        raise PayloadError(f"the message has {commas} commas, allowed: {MAX_VALUES}")

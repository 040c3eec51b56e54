"""Clients of ROS 1's actions, which are five topics, and what they send here instead.

rosbridge of ROS 2 has operations for actions, so these topics lead nowhere: an error says what to send.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from cobot.errors import InputError
from cobot.strict import shown

TOPICS = ("goal", "cancel", "feedback", "result", "status")
TYPES = re.compile(r".*Action(Goal|Feedback|Result)")


def refuse_topic(actions: Mapping[str, object], topic: str, type_: str | None) -> None:
    """Refuse what a ROS 1 client of an action advertises, publishes or subscribes.

    Args:
        actions: by their names.
        type_: if the client says one.

    Raises:
        InputError: it is such a topic, with the operation that sends a goal.
    """
    name, _, last = topic.rpartition("/")
    name = f"/{name.lstrip('/')}"
    if last not in TOPICS or not (name in actions or TYPES.fullmatch(type_ or "")):
        return
    meant = name if name in actions else f"one of {', '.join(actions) or 'none'}"
    raise InputError(
        f"{shown(topic)} is a topic of an action of ROS 1, which does nothing here: send the operation "
        f"send_action_goal, or cancel_action_goal, with `action` {meant}, and read action_feedback and "
        "action_result"
    )

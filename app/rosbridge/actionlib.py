"""Error messages for clients that use ROS 1 actions, which consist of five topics. The messages name the
operations to use instead.

rosbridge for ROS 2 has operations for actions, so these topics have no effect.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from cobot.errors import InputError
from cobot.strict import shown

TOPICS = ("goal", "cancel", "feedback", "result", "status")
TYPES = re.compile(r".*Action(Goal|Feedback|Result)")


def refuse_topic(actions: Mapping[str, object], topic: str, type_: str | None) -> None:
    """Reject the topics that a ROS 1 client uses for an action.

    Args:
        actions: the actions by name.
        type_: type that the client has given; None if it has given none.

    Raises:
        InputError: the topic belongs to a ROS 1 action. The error names the operation that sends a goal.
    """
    name, _, last = topic.rpartition("/")
    name = f"/{name.lstrip('/')}"
    if last not in TOPICS or not (name in actions or TYPES.fullmatch(type_ or "")):
        return
    meant = name if name in actions else f"one of {', '.join(actions) or 'none'}"
    raise InputError(
        f"{shown(topic)} is a topic of a ROS 1 action, which has no effect here: send the operation "
        f"send_action_goal, or cancel_action_goal, with `action` {meant}, and read action_feedback and "
        "action_result"
    )

"""The services of /rosapi, which list the topics, services, actions and types.

Source: https://github.com/RobotWebTools/rosbridge_suite/tree/ros2/rosapi_msgs
"""

from __future__ import annotations

from collections.abc import Callable

from app.graph.graph import Graph
from cobot.access.roles import Role
from cobot.errors import NotFoundError
from cobot.ros.messages import Message, Messages, ros_time
from cobot.strict import shown

_DETAILS = "TypeDef[] typedefs\n"
DEFINITIONS = {
    "rosapi_msgs/msg/TypeDef": (
        "string type\nstring[] fieldnames\nstring[] fieldtypes\nint32[] fieldarraylen\nstring[] examples\n"
        "string[] constnames\nstring[] constvalues\n"
    ),
    "rosapi_msgs/srv/Topics": "---\nstring[] topics\nstring[] types\n",
    "rosapi_msgs/srv/TopicType": "string topic\n---\nstring type\n",
    "rosapi_msgs/srv/TopicsForType": "string type\n---\nstring[] topics\n",
    "rosapi_msgs/srv/Publishers": "string topic\n---\nstring[] publishers\n",
    "rosapi_msgs/srv/Subscribers": "string topic\n---\nstring[] subscribers\n",
    "rosapi_msgs/srv/Services": "---\nstring[] services\n",
    "rosapi_msgs/srv/ServiceType": "string service\n---\nstring type\n",
    "rosapi_msgs/srv/ServicesForType": "string type\n---\nstring[] services\n",
    "rosapi_msgs/srv/Nodes": "---\nstring[] nodes\n",
    "rosapi_msgs/srv/NodeDetails": (
        "string node\n---\nstring[] subscribing\nstring[] publishing\nstring[] services\n"
    ),
    "rosapi_msgs/srv/GetActionServers": "---\nstring[] action_servers\n",
    "rosapi_msgs/srv/ActionType": "string action\n---\nstring type\n",
    "rosapi_msgs/srv/Interfaces": "---\nstring[] interfaces\n",
    "rosapi_msgs/srv/GetTime": "---\nbuiltin_interfaces/Time time\n",
    "rosapi_msgs/srv/GetROSVersion": "---\nuint8 version\nstring distro\n",
    "rosapi_msgs/srv/MessageDetails": f"string type\n---\n{_DETAILS}",
    "rosapi_msgs/srv/ServiceRequestDetails": f"string type\n---\n{_DETAILS}",
    "rosapi_msgs/srv/ServiceResponseDetails": f"string type\n---\n{_DETAILS}",
    "rosapi_msgs/srv/ActionGoalDetails": f"string type\n---\n{_DETAILS}",
    "rosapi_msgs/srv/ActionResultDetails": f"string type\n---\n{_DETAILS}",
    "rosapi_msgs/srv/ActionFeedbackDetails": f"string type\n---\n{_DETAILS}",
    "rosapi_msgs/srv/GetParamNames": "---\nstring[] names\n",
    "rosapi_msgs/srv/GetParam": "string name\nstring default_value\n---\nstring value\n",
    "rosapi_msgs/srv/SetParam": "string name\nstring value\n---\n",
    "rosapi_msgs/srv/HasParam": "string name\n---\nbool exists\n",
    "rosapi_msgs/srv/DeleteParam": "string name\n---\n",
}
NODE = "/cobot"
"""Name of the only ROS node. All topics and services of the graph belong to it."""
UNKNOWN = ""


def add_rosapi(graph: Graph) -> None:
    """Offer the services of /rosapi."""
    graph.messages.add_lazily(DEFINITIONS)
    for name, (type_, answer) in _services(graph).items():

        async def call(request: Message, answer: Callable[[Message], Message] = answer) -> Message:
            return answer(request)

        graph.add_service(
            f"/rosapi/{name}",
            f"rosapi_msgs/srv/{type_}",
            call,
            owner=graph,
            local=True,
            role=Role.OBSERVER,
        )


def _services(graph: Graph) -> dict[str, tuple[str, Callable[[Message], Message]]]:
    """Return the type and the function of each service, by name."""

    def named(table: Callable[[], dict[str, str]], wanted: str) -> list[str]:
        return [name for name, type_ in table().items() if type_ == wanted]

    def service_types() -> dict[str, str]:
        return {service.name: service.type for service in graph.services.values()}

    def action_types() -> dict[str, str]:
        return {name: server.action.type_ for name, server in graph.actions.items()}

    def details(kind: str, part: str) -> Callable[[Message], Message]:
        messages = graph.messages
        return lambda asked: {"typedefs": _details(messages, messages.resolved(asked["type"], kind) + part)}

    topics = graph.topics
    return {
        "topics": ("Topics", lambda _: {"topics": list(topics()), "types": list(topics().values())}),
        "topic_type": ("TopicType", lambda asked: {"type": topics().get(asked["topic"], UNKNOWN)}),
        "topics_for_type": ("TopicsForType", lambda asked: {"topics": named(topics, asked["type"])}),
        "publishers": ("Publishers", lambda asked: {"publishers": _ends(graph, asked["topic"], 0)}),
        "subscribers": ("Subscribers", lambda asked: {"subscribers": _ends(graph, asked["topic"], 1)}),
        "services": ("Services", lambda _: {"services": list(service_types())}),
        "service_type": (
            "ServiceType",
            lambda asked: {"type": service_types().get(asked["service"], UNKNOWN)},
        ),
        "services_for_type": (
            "ServicesForType",
            lambda asked: {"services": named(service_types, asked["type"])},
        ),
        "nodes": ("Nodes", lambda _: {"nodes": [NODE]}),
        "node_details": ("NodeDetails", lambda asked: _node(graph, asked["node"])),
        "action_servers": ("GetActionServers", lambda _: {"action_servers": list(graph.actions)}),
        "action_type": ("ActionType", lambda asked: {"type": action_types().get(asked["action"], UNKNOWN)}),
        "interfaces": ("Interfaces", lambda _: {"interfaces": sorted(graph.messages)}),
        "get_time": ("GetTime", lambda _: {"time": _now(graph)}),
        "get_ros_version": ("GetROSVersion", lambda _: {"version": 2, "distro": "humble"}),
        "message_details": ("MessageDetails", details("msg", "")),
        "service_request_details": ("ServiceRequestDetails", details("srv", "_Request")),
        "service_response_details": ("ServiceResponseDetails", details("srv", "_Response")),
        "action_goal_details": ("ActionGoalDetails", details("action", "_Goal")),
        "action_result_details": ("ActionResultDetails", details("action", "_Result")),
        "action_feedback_details": ("ActionFeedbackDetails", details("action", "_Feedback")),
        "get_param_names": ("GetParamNames", lambda _: {"names": []}),
        "has_param": ("HasParam", lambda _: {"exists": False}),
        "get_param": ("GetParam", _no_parameter),
        "set_param": ("SetParam", _no_parameter),
        "delete_param": ("DeleteParam", _no_parameter),
    }


def _no_parameter(asked: Message) -> Message:
    raise NotFoundError(
        f"there is no parameter {shown(asked['name'])}; cobot has no ROS parameters, its settings are files"
    )


def _now(graph: Graph) -> Message:
    return ros_time(graph.clock.wall_ns())


def _ends(graph: Graph, topic: str, which: int) -> list[str]:
    return [NODE] if graph.ends_of(topic)[which] else []


def _node(graph: Graph, node: str) -> Message:
    if node != NODE:
        raise NotFoundError(f"there is no node {shown(node)}; valid names: {NODE}")
    ends = {topic: graph.ends_of(topic) for topic in graph.topics()}
    return {
        "publishing": [topic for topic, (publishers, _) in ends.items() if publishers],
        "subscribing": [topic for topic, (_, subscribers) in ends.items() if subscribers],
        "services": list(graph.services),
    }


def _details(messages: Messages, name: str) -> list[Message]:
    """List the definitions of a type and of all types that it contains, each once."""
    made: dict[str, Message] = {}
    waiting = [name]
    while waiting:
        name = waiting.pop(0)
        if name in made:
            continue
        fields, constants = messages.fields(name), messages.constants(name)
        made[name] = {
            "type": name,
            "fieldnames": [field for field, _, _ in fields],
            "fieldtypes": [type_ for _, type_, _ in fields],
            "fieldarraylen": [length for _, _, length in fields],
            "examples": [_example(type_, length) for _, type_, length in fields],
            "constnames": [constant for constant, _, _ in constants],
            "constvalues": [str(value) for _, _, value in constants],
        }
        waiting += [type_ for _, type_, _ in fields if "/" in type_]
    return list(made.values())


def _example(type_: str, length: int) -> str:
    """Create an example value of a type, in the form that rosapi uses."""
    if length >= 0:
        return "[]"
    if "/" in type_:
        return "{}"
    return (
        "" if type_.endswith("string") else "False" if type_ == "bool" else "0.0" if "float" in type_ else "0"
    )

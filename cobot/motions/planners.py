"""The planners that a motion can request: their names and traits.

This table is the only list of planners. The web service, the schemas, the documents and `cobot.planners` read
it; the web service does not import `cobot.planners`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, StrEnum


class PlannerName(StrEnum):
    """The planners that a motion can request, in the order in which schemas and documents list them."""

    PTP = "ptp"
    LIN = "lin"
    CIRC = "circ"
    POLYLINE = "polyline"
    OMPL = "ompl"
    CHOMP = "chomp"
    AUTO = "auto"


class Way(Enum):
    """The kind of path that a planner finds to the goal. It determines the arguments of the planner's
    function.

    PATH: the TCP follows the path of the request, whose goal is a pose, never joint angles.
        `function(robot, request)` returns None if the arm is already at the goal.
    DIRECT: the joints move to the nearest joint angles of the goal. The function is called as
        `function(robot, request, joints)`.
    SEARCH: the planner finds a path around obstacles to any joint angles of the goal, and first leaves a
    start
        in collision. The function is called as `function(robot, request, goals)`, where the nearest goal is
        the first.
    """

    PATH = "path"
    DIRECT = "direct"
    SEARCH = "search"


@dataclass(frozen=True, slots=True)
class PlannerTraits:
    """The properties of a planner that other modules need.

    Attributes:
        function: the function that plans, as "module:function" below `cobot.planners`; for its arguments see
            `Way`. Empty for auto, which calls other planners.
        way: the kind of path to the goal.
        summary: the motion in a few words, for schemas.
        fields: the optional fields of `MotionRequest` that the planner uses. A request with any other
            optional field is rejected.
        needs: fields; the request must give exactly one of them.
        missing: the error, with advice, if the request gives none of the fields in `needs`.
        one_piece: whether the rest of a path after a stop cannot be planned as a separate motion. For a line
            it can be.
        alternative: the planner to try if this one finds no motion.
    """

    function: str
    way: Way
    summary: str
    fields: frozenset[str] = frozenset()
    needs: tuple[str, ...] = ()
    missing: str = ""
    one_piece: bool = False
    alternative: PlannerName = PlannerName.AUTO


TCP_PATH = frozenset({"tcp_speed", "cyclic", "end_joints"})
"""The fields that all planners of TCP paths use."""

PLANNERS: dict[PlannerName, PlannerTraits] = {
    PlannerName.PTP: PlannerTraits(
        "ptp:plan_ptp",
        Way.DIRECT,
        "in joint space",
        frozenset({"synchronization"}),
    ),
    PlannerName.LIN: PlannerTraits(
        "path.lin:plan_lin",
        Way.PATH,
        "the TCP on a straight line",
        TCP_PATH,
    ),
    PlannerName.CIRC: PlannerTraits(
        "path.circ:plan_circ",
        Way.PATH,
        "the TCP on an arc",
        TCP_PATH | {"via", "arc"},
        needs=("via", "arc"),
        missing="via: is missing; planner circ needs a point on its arc, or its centre",
        one_piece=True,
    ),
    PlannerName.POLYLINE: PlannerTraits(
        "path.polyline:plan_polyline",
        Way.PATH,
        "the TCP on straight lines through several poses",
        TCP_PATH | {"through", "radius_m"},
        needs=("through",),
        missing="through: is empty; planner polyline needs at least one pose on the way; otherwise use lin",
        one_piece=True,
    ),
    PlannerName.OMPL: PlannerTraits(
        "search.ompl:plan_ompl",
        Way.SEARCH,
        "sampling, around obstacles",
        frozenset({"algorithm"}),
        alternative=PlannerName.CHOMP,
    ),
    PlannerName.CHOMP: PlannerTraits(
        "search.chomp:plan_chomp",
        Way.SEARCH,
        "optimisation, around obstacles",
    ),
    PlannerName.AUTO: PlannerTraits(
        "",
        Way.SEARCH,
        "ptp if that is free, else ompl",
        frozenset({"algorithm"}),
        alternative=PlannerName.CHOMP,
    ),
}

BODY_FIELDS: dict[str, tuple[str, ...]] = {
    "via": ("via",),
    "arc": ("centre", "axis"),
    "through": ("through",),
    "radius_m": ("radius",),
    "tcp_speed": ("speed_m_s", "speed_rad_s"),
    "synchronization": ("synchronization",),
    "algorithm": ("algorithm",),
    "cyclic": ("cyclic",),
    "end_joints": ("end_joints",),
}
"""The fields of `MotionRequest` that not every planner uses, and their names in requests as JSON."""


ANY_GOAL = tuple(name for name, traits in PLANNERS.items() if traits.way is not Way.PATH)
"""The planners that can move to joint angles as well as to a pose."""
PATHS = tuple(name for name, traits in PLANNERS.items() if traits.way is Way.PATH)
"""The planners that follow a TCP path to a pose."""
GOAL_ALONE = tuple(name for name, traits in PLANNERS.items() if not traits.needs)
"""The planners that need only a goal."""


def users_of(field: str) -> str:
    """The planners that use a field of `MotionRequest`, as text: "lin, circ and polyline"."""
    return in_words([name for name, traits in PLANNERS.items() if field in traits.fields])


def in_words(names: Iterable[str], conjunction: str = "and") -> str:
    """The names as a list in a sentence: "lin, circ and polyline"."""
    *others, last = names
    return f"{', '.join(others)} {conjunction} {last}" if others else str(last)


def summaries(names: Iterable[PlannerName]) -> str:
    """The summaries of these planners, for schemas."""
    return "; ".join(f"{name}: {PLANNERS[name].summary}" for name in names) + "."

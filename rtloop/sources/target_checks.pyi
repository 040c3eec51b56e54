from cobot.types import Array
from rtloop.results import Accepted, Rejected

JOINT_VELOCITY: float
LINEAR_VELOCITY: float
ANGULAR_VELOCITY: float
DEFAULT_INTERVAL_S: float
MIN_INTERVAL_S: float
MAX_INTERVAL_S: float

def angular_distance(first: Array, second: Array) -> float: ...
def is_finite(values: Array) -> bool: ...
def clamped_interval(interval_s: float) -> float: ...
def check_joint_step(
    target: Array,
    last: Array,
    interval_s: float = ...,
    max_velocity: Array | None = None,
    names: tuple[str, ...] = (),
) -> Accepted | Rejected: ...
def check_pose_step(
    pose: Array,
    last: Array,
    interval_s: float = ...,
    max_linear: float = ...,
    max_angular: float = ...,
) -> Accepted | Rejected: ...

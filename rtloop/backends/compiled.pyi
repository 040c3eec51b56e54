from cobot.types import Array

JOINT_ROWS: int
"""Rows of `Measured.joints`."""

class Measured:
    """What a robot reports in one cycle, in one buffer: a single product finds what is not finite.

    External means: what the surroundings do to the arm, as far as the device can tell it from its
    own weight and motion; zeros if it cannot. To assign to an attribute copies into the buffer.

    Attributes:
        values: all of it, shape (5 dof + 12,).
        joints: the five rows that follow, shape (5, dof).
        position, velocity: rad, rad/s.
        effort: torques of the drives, N·m.
        desired_effort: torques that the drives were told to produce, N·m.
        external_effort: torques that the surroundings exert on the joints, N·m.
        wrench: force and torque that the surroundings exert at the TCP, shape (6,), N and N·m, in the base
            frame.
        external: the external torques and the wrench, shape (dof + 6,).
        sensor: raw readings of a force-torque sensor at the flange, shape (6,), N and N·m, in the TCP's
            frame: tool weight and inertia are in them.

    Raises:
        InputError: more joints than compiled code has room for.
    """

    values: Array
    joints: Array
    position: Array
    velocity: Array
    effort: Array
    desired_effort: Array
    external_effort: Array
    wrench: Array
    external: Array
    sensor: Array

    def __init__(self, dof: int) -> None: ...

class CompiledBackend:
    """A `Backend` whose reading and writing the loop calls without Python (rtloop/backends/compiled.pxd).

    `c_read(values)` fills the buffer of a `Measured`, `c_write(command)` takes the rows position, velocity
    and acceleration. Each returns 0, or another number when nothing was done and the Python method is to be
    called instead: it raises BackendError with the reason, or is that of a subclass written in Python.
    Measured and commanded are for as many joints as the backend has.
    """

    def try_read(self, measured: Measured) -> bool:
        """What the loop does first: False if it is to call `read`."""

    def try_write(self, command: Array) -> bool:
        """Likewise; `command` is shape (3, dof)."""

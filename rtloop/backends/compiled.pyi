from cobot.types import Array

class Measured:
    """What a robot reports in one cycle, in one buffer: a single product finds what is not finite.

    Its fields are the measured ones of `cobot.ipc.state_fields`. Assigning to an attribute copies into the
    buffer. `external_effort` and `wrench` are what the surroundings do to the arm, without its own weight and
    motion; zeros if the device cannot separate them. `sensor` includes the tool's weight and inertia.

    Attributes:
        values: all fields, one after the other.
        joints: the fields per joint, a row for each.
        external: `external_effort` and `wrench`, shape (dof + 6,).

    Raises:
        InputError: more joints than compiled code has room for.
    """

    values: Array
    joints: Array
    external: Array
    # measured fields: begin
    # Measured joint positions; rad or m.
    position: Array
    # Measured joint velocities; rad/s or m/s.
    velocity: Array
    # Measured joint efforts; N·m or N.
    effort: Array
    # Joint efforts requested from the drives; N·m or N.
    desired_effort: Array
    # Estimated joint efforts that the surroundings exert; N·m or N.
    external_effort: Array
    # Estimated force and torque on the TCP, in the base frame; N, N·m.
    wrench: Array
    # Force and torque of the sensor, raw, in the TCP's frame; N, N·m.
    sensor: Array
    # measured fields: end
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

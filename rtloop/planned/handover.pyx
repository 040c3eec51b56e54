"""Loads a trajectory from the service into the cycle, while the arm continues its current activity."""

from rtloop.planned.path cimport Path

from rtloop.planned.loading import load
from rtloop.results import LATER, Rejected

_WHOLE = object()
# Maximum distance of a motion's start from the commanded position. It allows for rounding by the planner and
# smoothing by the safety layer.
START_TOLERANCE_RAD = 1e-3


cdef class Handover:
    """Loads one trajectory at a time into a separate path, one piece per cycle. Real-time safe.

    Attributes:
        load: whether a trajectory is being loaded, and for which purpose; `begin_start`, `begin_replacement`
            and `end` change it.
        path: the path into which it loads. It is complete once `step` has returned True.
        number: number of the command that requested it.
        motion_id, slot: the motion that is loaded, and its slot.
        offset_s: path time of the current motion at which a replacement begins.
    """

    def __init__(self, model, capacity, slots):
        """
        Args:
            model: the model. A motion must have been planned for its limits and its tool.
            capacity: maximum number of segments of a path.
            slots: slots of shared memory from which trajectories are read.
        """
        self.path = Path(capacity, model.limits.dof)
        self._slots, self._model, self._loader = slots, model, None
        self.load = NO_LOAD

    def begin_start(self, command, position):
        """Begin to load a motion that starts at rest at the commanded position, (dof,), rad."""
        return self._begin(START, command, position, position, 0.0)

    def begin_replacement(self, command, position, offset_s):
        """Begin to load a trajectory that replaces the current one from a path time on."""
        return self._begin(REPLACEMENT, command, position, None, offset_s)

    def _begin(self, Load kind, command, position, start, offset_s):
        slot = int(command["slot"])
        if slot >= len(self._slots):
            return Rejected(f"there is no slot {slot}")
        planned, carried = int(command["tool"]), self._model.tool.version
        if planned != carried:
            return Rejected(
                f"the motion was planned with version {planned} of the tool, the arm has version {carried}"
            )
        self.number, self.motion_id, self.slot = int(command["id"]), int(command["motion_id"]), slot
        self.offset_s, self.load = offset_s, kind
        limits = self._model.limits.including(position)
        self._loader = load(self.path, self._slots[slot], self.motion_id, start, START_TOLERANCE_RAD, limits)
        return LATER

    def step(self):
        """Load one piece. Returns whether it was the last one.

        Raises:
            RefusedError: the trajectory is invalid.
        """
        return next(self._loader, _WHOLE) is _WHOLE

    def end(self):
        """End the loading, whatever its result. Returns the number of its command."""
        self._loader, self.load = None, NO_LOAD
        return self.number

    def fence(self):
        """The fence of the motion, as it is in the slot."""
        return self._slots[self.slot].head.data["fence"]

    def signals(self):
        """The actions and conditions of the motion, as they are in the slot."""
        return self._slots[self.slot].head.data["signals"]

    def swap(self, Path path not None):
        """Return the loaded path, and keep the previous path for the next trajectory."""
        loaded, self.path = self.path, path
        return loaded

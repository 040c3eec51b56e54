"""A trajectory on its way from the service into the cycle, while the arm goes on with what it does."""

from rtloop.planned.path cimport Path

from rtloop.planned.loading import load
from rtloop.results import LATER, Rejected

_WHOLE = object()
# How far a motion may start from the commanded position: planning rounds, the safety layer smooths.
START_TOLERANCE_RAD = 1e-3


cdef class Handover:
    """Loads one trajectory at a time into a path of its own, a piece in each cycle. Real-time safe.

    Attributes:
        load: whether it loads, and what for; `begin_start`, `begin_replacement` and `end` change it.
        path: what it loads into, whole once `step` has said so.
        number: of the command that asks for it.
        motion_id, slot: what it loads, and where from.
        offset_s: path time of the motion under way at which a replacement begins.
    """

    def __init__(self, model, capacity, slots):
        """
        Args:
            model: with its limits and its tool, for which a motion has to be planned.
            capacity: segments of a path.
            slots: of shared memory, where trajectories are read from.
        """
        self.path = Path(capacity, model.limits.dof)
        self._slots, self._model, self._loader = slots, model, None
        self.load = NO_LOAD

    def begin_start(self, command, position):
        """Begin to load a motion that starts at rest at the commanded position, (dof,), rad."""
        return self._begin(START, command, position, position, 0.0)

    def begin_replacement(self, command, position, offset_s):
        """Begin to load the continuation of the present motion from a path time on."""
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
        """A piece; whether it was the last one.

        Raises:
            RefusedError: it is no trajectory that may be followed.
        """
        return next(self._loader, _WHOLE) is _WHOLE

    def end(self):
        """Whatever has come of it; the number of its command."""
        self._loader, self.load = None, NO_LOAD
        return self.number

    def fence(self):
        """What the motion must not leave, as it stands in the slot."""
        return self._slots[self.slot].head.data["fence"]

    def signals(self):
        """The actions and conditions of the motion, as they stand in the slot."""
        return self._slots[self.slot].head.data["signals"]

    def swap(self, Path path not None):
        """Give what has been loaded for the path that was followed so far."""
        loaded, self.path = self.path, path
        return loaded

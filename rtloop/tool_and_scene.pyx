"""What the arm carries, and what stands around it: both change while it rests."""

from cobot.errors import CobotError, InputError, LimitError
from cobot.ipc.tool_record import load_of
from cobot.robot.tool import check_tool
from rtloop.backends import BackendError, CarriesTool, HasCell
from rtloop.results import ACCEPTED, LATER, Rejected
from rtloop.streaming.surroundings import Surroundings

from rtloop.streaming.session cimport Session


cdef class ToolAndScene:
    """Tells model, device and streams of them. On events alone.

    Attributes:
        surroundings: reads what stands around the arm.
        known: how far that is known; `hear_of` and `heed` change it.
        scene_known: `Accepted` if the collision monitor knows the scene, `Rejected` with the reason if not.
    """

    def __init__(self, settings, model, memory, backend, Session streaming):
        self._model, self._info, self._tool = model, memory.info, memory.tool
        self._max_payload_kg = settings.robot.max_payload_kg
        self._backend, self._streaming = backend, streaming
        self.surroundings = Surroundings(settings, model)
        self.known = ALL
        self.scene_known = ACCEPTED

    def carry(self, tool, mounted=None):
        """Have this tool on the flange from the next cycle on: in the model and, if it wants to know, in the
        backend. Some 500 µs, so only while nothing moves.

        Args:
            mounted: the tool without the parts of a simulated cell; None: none are held.

        Raises:
            BackendError: the robot refuses it; nothing has changed.
        """
        if isinstance(self._backend, CarriesTool):
            self._backend.set_tool(tool)
        if isinstance(self._backend, HasCell):
            self._backend.mount(tool if mounted is None else mounted)
        self._model.carry(tool)
        self._info.data["flange"] = self._model.flange_in_tcp().numbers
        self._info.data["tool_version"] = tool.version
        self._info.publish()

    def take(self, version, scene_version):
        """Carry the tool of the tool's block. The arm rests: the command stays the same, and the torques that
        hold it follow the weight within the same cycle.
        """
        if not self._tool.try_read():
            return Rejected("the tool could not be read")
        try:
            tool, mounted = load_of(self._tool.data)
            for each in (tool, mounted):
                check_tool(each, self._max_payload_kg, self._model.file_gravity)
            if tool.version != version:
                return Rejected(f"version {tool.version} of the tool stands there, not {version}")
            self.carry(tool, mounted)
            self.hear_of(scene_version)  # Its shapes stand in its file.
        except (InputError, LimitError, ValueError, BackendError) as exc:
            return Rejected(str(exc))
        return ACCEPTED

    def hear_of(self, version):
        """The files hold another scene, or other shapes of the tool; nothing is being read."""
        self.known = CHANGED
        self._info.data["scene_version"] = version
        self._info.publish()

    def watch_scene(self):
        """Have streams know from the beginning what stands around the arm; before the first cycle."""
        try:
            self._streaming.watch(self.surroundings.read())
        except CobotError as exc:
            self.scene_known = Rejected(str(exc))
        self._info.data["scene_version"] = self.surroundings.version

    cdef void heed(self) except *:
        """Have the surroundings read, or take over what has been made of them."""
        if self.known == CHANGED:
            self.known = BEING_READ
            self.surroundings.begin()
            return
        made = self.surroundings.take()
        if made is LATER:
            return
        self.known = ALL
        if isinstance(made, Rejected):
            self.scene_known = made
            return
        self.scene_known = ACCEPTED
        self._streaming.watch(made)

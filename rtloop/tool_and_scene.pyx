"""The arm's tool and surroundings. Both change only while the arm is at rest."""

from cobot.errors import CobotError, InputError, LimitError
from cobot.ipc.tool_record import load_of
from cobot.robot.tool import check_tool
from rtloop.backends import BackendError, CarriesTool, HasCell
from rtloop.results import ACCEPTED, LATER, Rejected
from rtloop.streaming.surroundings import Surroundings

from rtloop.streaming.session cimport Session


cdef class ToolAndScene:
    """Passes the tool and the surroundings to the model, the device and the streaming sessions. Its methods
    run only on events.

    Attributes:
        surroundings: reads the surroundings of the arm.
        known: progress of reading them, which `hear_of` and `heed` change.
        scene_known: `Accepted` if the collision monitor has the scene, otherwise `Rejected` with the reason.
    """

    def __init__(self, settings, model, memory, backend, Session streaming):
        self._model, self._info, self._tool = model, memory.info, memory.tool
        self._max_payload_kg = settings.robot.max_payload_kg
        self._backend, self._streaming = backend, streaming
        self.surroundings = Surroundings(settings, model)
        self.known = ALL
        self.scene_known = ACCEPTED

    def carry(self, tool, mounted=None):
        """Use this tool from the next cycle on, in the model and, if the backend needs it, in the backend.
        This takes about 500 µs, so it is done only while nothing moves.

        Args:
            mounted: the tool without the parts of a simulated cell; None: no parts are held.

        Raises:
            BackendError: the robot rejects the tool; nothing has changed.
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
        """Use the tool in the tool's block of shared memory. The arm is at rest: the command stays the same,
        and the holding torques match the new weight in the same cycle.
        """
        if not self._tool.try_read():
            return Rejected("the tool could not be read")
        try:
            tool, mounted = load_of(self._tool.data)
            for each in (tool, mounted):
                check_tool(each, self._max_payload_kg, self._model.file_gravity)
            if tool.version != version:
                return Rejected(f"shared memory has version {tool.version} of the tool, not {version}")
            self.carry(tool, mounted)
            self.hear_of(scene_version)  # so that the tool's shapes are read from its file
        except (InputError, LimitError, ValueError, BackendError) as exc:
            return Rejected(str(exc))
        return ACCEPTED

    def hear_of(self, version):
        """Record that the files have a different scene or different shapes of the tool. They are not read
        yet.
        """
        self.known = CHANGED
        self._info.data["scene_version"] = version
        self._info.publish()

    def watch_scene(self):
        """Read the surroundings before the first cycle, so that the first streaming session already has
        them.
        """
        try:
            self._streaming.watch(self.surroundings.read())
        except CobotError as exc:
            self.scene_known = Rejected(str(exc))
        self._info.data["scene_version"] = self.surroundings.version

    cdef void heed(self) except *:
        """Begin to read the surroundings if they have changed, or use the finished result."""
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

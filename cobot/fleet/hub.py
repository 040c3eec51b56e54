"""The hub: its data about all cells, and the commands that it sends to them."""

from __future__ import annotations

import contextlib
import logging
import secrets
import threading
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter, ValidationError

from cobot.access.roles import RoleName
from cobot.errors import BusyError, ConflictError, InputError, NotFoundError, UnavailableError
from cobot.fleet.certificates import Signer
from cobot.fleet.link import open_hub, payloads
from cobot.fleet.messages import (
    DEADLINE_S,
    KEPT_EVENTS,
    MAX_BYTES,
    REST_S,
    CommandAnswer,
    FleetAction,
    FleetCommand,
    FleetProgram,
    FleetState,
    HubTime,
    RobotEvent,
    StopArm,
    read,
    written,
)
from cobot.fleet.names import FleetKeys, parts
from cobot.fleet.panel_link import PanelLink
from cobot.fleet.recordings import FleetRecordingStore, RecordingPuller
from cobot.fleet.roll_outs import RollOuts

if TYPE_CHECKING:
    import zenoh

MAX_ROBOTS = 10_000
"""Maximum number of robots that are kept."""
STOP = StopArm(kind="stop")
RETRY_S = 0.1
FILE_S = 30.0
"""Timeout for a piece of a recording, for the hash of a large recording, and for a picture, in seconds."""
ROLL_OUT_S = 20.0
"""Deadline for the commands of a roll-out, in seconds."""
CHECK_S = 180.0
"""Timeout for a cell to check or store a bundle, in seconds."""
ASK_S = 2.0
MAX_PROGRAMS_BYTES = 2**20
MAX_PICTURE_BYTES = 4 * 2**20
PNG = b"\x89PNG\r\n\x1a\n"
NOT_STOPPED = "the arm is NOT known to be stopped: use its emergency stop"
NOT_KNOWN = "inspect the cell before you try again"
_EVENTS = TypeAdapter(list[RobotEvent])
_PROGRAMS = TypeAdapter(list[FleetProgram])

log = logging.getLogger("cobot.fleet")


@dataclass(slots=True)
class Tile:
    """The hub's data about a robot.

    Attributes:
        heard_s: time at which the latest state arrived, on this computer's clock.
        gone_s: time at which the robot's cell was lost; None while the cell is connected.
        asked: the instances of the cell from which the hub has requested earlier events.
    """

    state: FleetState
    heard_s: float
    gone_s: float | None = None
    events: dict[str, RobotEvent] = field(default_factory=dict)
    asked: set[str] = field(default_factory=set)

    def add(self, event: RobotEvent) -> None:
        """Add an event, in any order. Only the latest events are kept."""
        self.events[event.id] = event
        newest = sorted(self.events.values(), key=lambda each: each.time)[-KEPT_EVENTS:]
        self.events = {each.id: each for each in newest}


def _worst(answers: list[CommandAnswer]) -> dict[tuple[str, str], CommandAnswer]:
    """One answer for each name: the worst one.

    If two cells use the same name, a success of one cell must not hide a failure of the other.
    """
    found: dict[tuple[str, str], CommandAnswer] = {}
    for answer in answers:
        name = answer.cell, answer.robot
        if name not in found or found[name].code == "ok":
            found[name] = answer
    return found


def _events_in(content: bytes, cell: str, robot: str) -> list[RobotEvent]:
    """Read events from the answer of a robot.

    Raises:
        InputError: the content is too long.
        ValidationError: the content is not a list of events.
    """
    if len(content) > KEPT_EVENTS * MAX_BYTES:
        raise InputError(f"the events of {cell}/{robot} have {len(content)} bytes")
    events = _EVENTS.validate_json(content)
    return [event for event in events if (event.cell, event.robot) == (cell, robot)]


def _is_open(answer: CommandAnswer | None) -> bool:
    """Whether a command with this answer must be sent again."""
    return answer is None or answer.code in (BusyError.code, UnavailableError.code)


class Hub:
    """One hub of a fleet. Its methods may be called from any thread.

    Attributes:
        hosts: names and addresses of this computer that the hub's certificate contains.
        panels: the cells' panels that people have opened; None if there are no certificates.
        counts: numbers of answers to commands, by action and code.

    Args:
        listen: addresses for the cells, such as tcp/127.0.0.1:7447.
        connect: routers that the hub connects to.
        certificates: folder of the fleet's certificates. With it, connections are encrypted, both sides show
            their certificates, and commands are signed.
        recordings: store for recordings from the cells; None means that recordings are not fetched.

    Raises:
        ConfigError: a certificate cannot be used.
        UnavailableError: the hub cannot listen on an address, or cannot reach a router.
        ConflictError: the fleet already has a hub.
    """

    def __init__(
        self,
        fleet: str,
        listen: list[str],
        connect: Iterable[str] = (),
        certificates: Path | None = None,
        recordings: FleetRecordingStore | None = None,
    ) -> None:
        self.fleet = fleet
        self.instance = secrets.token_hex(8)
        self._keys = FleetKeys(fleet)
        self._tiles: dict[tuple[str, str], Tile] = {}
        self._instances: dict[str, set[str]] = {}
        self._lock = threading.Lock()
        self._signer = Signer(certificates) if certificates else None
        self._session: zenoh.Session = open_hub(fleet, listen, list(connect), certificates)
        self.hosts = [] if self._signer is None else self._signer.hosts
        self.roll_outs = RollOuts()
        self.panels: PanelLink | None = None
        if self._signer is not None:
            self.panels = PanelLink(fleet, self.instance, self._keys, self._session, self._signer)
        self.counts: Counter[tuple[str, str]] = Counter()
        try:
            self._declare()
        except BaseException:
            self._session.close()
            raise
        self.recordings = recordings
        self._puller = (
            RecordingPuller(recordings, self._robots_with_recordings, self._ask_file) if recordings else None
        )

    def close(self) -> None:
        if self._puller is not None:
            self._puller.close()
        self._session.close()

    def _robots_with_recordings(self) -> list[tuple[str, str]]:
        return [
            (each["cell"], each["robot"]) for each in self.cells() if each["alive"] and each["recordings"]
        ]

    def programs(self, cell: str, robot: str) -> list[dict[str, Any]]:
        """The stored programs of a robot: `id`, `label` and latest `version`.

        Raises:
            NotFoundError: the fleet has no such cell or robot.
            UnavailableError: the cell does not answer.
        """
        self.robots_of(cell, robot)
        replies = payloads(self._session.get(self._keys.of(cell, robot, "programs"), timeout=ASK_S))
        for content in replies:
            if len(content) > MAX_PROGRAMS_BYTES:
                raise UnavailableError(
                    f"{cell}/{robot}: the list of programs has {len(content)} bytes, which is too long"
                )
            with contextlib.suppress(ValidationError):
                return [each.model_dump() for each in _PROGRAMS.validate_json(content)]
        raise UnavailableError(f"{cell}/{robot}: the cell does not answer")

    def picture(self, cell: str, robot: str) -> bytes:
        """A picture that shows the arm as it is now, as PNG.

        Raises:
            NotFoundError: the fleet has no such cell or robot.
            UnavailableError: the cell does not answer, or cannot make a picture.
        """
        self.robots_of(cell, robot)
        for content in payloads(self._session.get(self._keys.of(cell, robot, "picture"), timeout=FILE_S)):
            if content.startswith(PNG) and len(content) <= MAX_PICTURE_BYTES:
                return content
        raise UnavailableError(f"{cell}/{robot}: the cell cannot draw a picture; its log has the reason")

    def _ask_file(self, cell: str, robot: str, last: str, question: bytes | None) -> bytes | None:
        import zenoh

        key = self._keys.of(cell, robot, last)
        with contextlib.suppress(zenoh.ZError):
            background = zenoh.Priority.BACKGROUND
            for content in payloads(
                self._session.get(key, payload=question, timeout=FILE_S, priority=background)
            ):
                return content
        return None

    def time(self) -> HubTime:
        return HubTime(epoch=self.instance, time_s=time.monotonic())

    def cells(self) -> list[dict[str, Any]]:
        """All robots of all cells, sorted by name."""
        with self._lock:
            return [self._shown(tile) for _, tile in sorted(self._tiles.items())]

    def robots_of(self, cell: str, robot: str | None = None) -> list[dict[str, Any]]:
        """All robots of a cell, or one robot.

        Raises:
            NotFoundError: the fleet has no such cell or robot. The error lists the names that exist.
        """
        robots = [each for each in self.cells() if each["cell"] == cell]
        if not robots:
            names = ", ".join(sorted({each["cell"] for each in self.cells()})) or "none"
            raise NotFoundError(f"there is no cell {cell!r} in the fleet {self.fleet}; valid names: {names}")
        found = [each for each in robots if robot in (None, each["robot"])]
        if not found:
            names = ", ".join(each["robot"] for each in robots)
            raise NotFoundError(f"the cell {cell} has no robot {robot!r}; it has: {names}")
        return found

    def forget(self, cell: str) -> None:
        """Remove the data of a cell that is gone. If the cell connects again, it is treated as a new cell.

        Raises:
            NotFoundError: the fleet has no such cell.
            ConflictError: the cell is connected.
        """
        self.robots_of(cell)
        with self._lock:
            if self._instances.get(cell):
                raise ConflictError(f"the cell {cell} is connected; end its process before you remove it")
            for name in [name for name in self._tiles if name[0] == cell]:
                del self._tiles[name]

    def events(self, cell: str, robot: str | None = None) -> list[dict[str, Any]]:
        """The last events of a cell, oldest first.

        Raises:
            NotFoundError: the fleet has no such cell or robot.
        """
        self.robots_of(cell, robot)
        with self._lock:
            found = [
                event.model_dump()
                for (name, each), tile in self._tiles.items()
                if name == cell and robot in (None, each)
                for event in tile.events.values()
            ]
        return sorted(found, key=lambda event: str(event["time"]))

    def command(
        self,
        action: FleetAction,
        who: str,
        role: RoleName = "admin",
        cell: str = "*",
        robot: str = "*",
        zone: str | None = None,
        *,
        deadline_s: float = DEADLINE_S,
        work_s: float = REST_S,
        command_id: str | None = None,
    ) -> list[dict[str, Any]]:
        """Send a command to several robots at the same time, and wait until it is done.

        The command is sent again, until the deadline, to a cell that does not answer. The cell recognises the
        retry by the id.

        Args:
            who, role: the person or program, and its role at the hub.
            cell, robot: names of the targets; "*" for all.
            zone: if given, only cells of this zone.
            deadline_s: time in which a cell must receive the command.
            work_s: time in which a cell must execute it.
            command_id: id of an earlier call that is repeated.

        Returns:
            For each robot: cell, robot, code ("ok" for success, which for a stop means that the arm is at
            rest) and text.

        Raises:
            NotFoundError: the fleet has no such cell, robot or zone.
        """
        wanted = self._robots(cell, robot, zone)
        now_s = time.monotonic()
        command = FleetCommand(
            id=command_id or secrets.token_hex(12),
            fleet=self.fleet,
            cell=cell,
            robot=robot,
            zone=zone,
            action=action,
            who=who,
            role=role,
            epoch=self.instance,
            issued_s=now_s,
            expires_s=now_s + deadline_s,
        )
        payload = written(command if self._signer is None else self._signer.signed(command))
        key = self._keys.of(cell, robot, "command")
        alive = {(each["cell"], each["robot"]) for each in wanted if each["alive"]}
        answers = self._answers_of(alive, key, payload, command.expires_s, deadline_s + work_s)
        for name in sorted({(each["cell"], each["robot"]) for each in wanted} - answers.keys()):
            text = self._why_no_answer(name, action)
            answers[name] = CommandAnswer(
                id=command.id, cell=name[0], robot=name[1], code="unavailable", text=text
            )
        self.counts.update((action.kind, answer.code) for answer in answers.values())
        log.warning("%s: %s to %s/%s: %s", who, action.kind, cell, robot, _counts(answers.values()))
        return [answer.model_dump() for _, answer in sorted(answers.items())]

    def _answers_of(
        self, missing: set[tuple[str, str]], key: str, payload: bytes, until_s: float, timeout_s: float
    ) -> dict[tuple[str, str], CommandAnswer]:
        """Send a command repeatedly until all `missing` robots have answered, or until `until_s` on
        `time.monotonic`.
        """
        answers: dict[tuple[str, str], CommandAnswer] = {}
        while True:
            found = _worst(self._ask(key, payload, timeout_s))
            answers |= {name: answer for name, answer in found.items() if _is_open(answers.get(name))}
            missing = {name for name in missing if _is_open(answers.get(name))}
            if not missing or time.monotonic() > until_s:
                return answers
            time.sleep(RETRY_S)

    def _robots(self, cell: str, robot: str, zone: str | None) -> list[dict[str, Any]]:
        if zone is None:
            return self.cells() if cell == "*" else self.robots_of(cell, None if robot == "*" else robot)
        found = [each for each in self.cells() if each["zone"] == zone]
        if not found:
            zones = ", ".join(sorted({each["zone"] for each in self.cells()} - {""})) or "none"
            raise NotFoundError(f"the fleet {self.fleet} has no cell in the zone {zone!r}; zones: {zones}")
        return found

    def _why_no_answer(self, name: tuple[str, str], action: FleetAction) -> str:
        tile = self._tiles.get(name)
        end = NOT_STOPPED if isinstance(action, StopArm) else NOT_KNOWN
        if tile is not None and tile.gone_s is not None:
            return f"the cell has been gone for {time.monotonic() - tile.gone_s:.1f} s; {end}"
        return f"the cell has not answered; {end}"

    def _ask(self, key: str, command: bytes, timeout_s: float) -> list[CommandAnswer]:
        import zenoh

        replies = self._session.get(
            key,
            payload=command,
            timeout=timeout_s,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        answers = []
        for reply in replies:
            if reply.ok is None:
                continue
            with contextlib.suppress(InputError):
                answer = read(CommandAnswer, bytes(reply.ok.payload))
                if (answer.cell, answer.robot) == parts(str(reply.ok.key_expr)):
                    answers.append(answer)
        return answers

    def _declare(self) -> None:
        session, keys = self._session, self._keys
        others = [
            str(reply.ok.key_expr)
            for reply in session.liveliness().get(keys.hub("*"), timeout=ASK_S)
            if reply.ok is not None
        ]
        if others:
            raise ConflictError(
                f"the fleet {self.fleet} already has a hub, and only one may run; stop the other hub, "
                "or give this one a different --name"
            )
        self._declared = [
            session.liveliness().declare_token(keys.hub(self.instance)),
            session.declare_queryable(keys.time, lambda query: query.reply(keys.time, written(self.time()))),
            session.declare_queryable(keys.bundle("*"), self._give_bundle),
            session.declare_subscriber(keys.of("*", "*", "state"), self._take_state),
            session.declare_subscriber(keys.of("*", "*", "event"), self._take_event),
            session.liveliness().declare_subscriber(keys.alive("*", "*"), self._take_presence, history=True),
        ]

    def roll_out(
        self,
        bundle: str,
        who: str,
        role: RoleName,
        robots: Sequence[tuple[str, str]],
        wave: int,
        watch_s: float,
    ) -> dict[str, Any]:
        """Start to roll out a bundle. See `RollOuts.begin`.

        Args:
            robots: pairs of cell and robot; "*" means the only robot of a cell.

        Raises:
            NotFoundError, BusyError, InputError: see `RollOuts.begin`. Also if a robot is unknown, or if "*"
                is given for a cell with several robots.
        """
        named = [self._only(cell, robot) for cell, robot in robots]
        twice = sorted({robot for robot in named if named.count(robot) > 1})
        if twice:
            raise InputError(f"{'/'.join(twice[0])} is listed twice")

        def send(action: FleetAction, cell: str, robot: str) -> dict[str, Any]:
            answers = self.command(action, who, role, cell, robot, deadline_s=ROLL_OUT_S, work_s=CHECK_S)
            return answers[0]

        def states() -> dict[tuple[str, str], str]:
            return {(each["cell"], each["robot"]): each["state"] for each in self.cells()}

        return self.roll_outs.begin(bundle, who, role, named, wave, watch_s, send, states)

    def _only(self, cell: str, robot: str) -> tuple[str, str]:
        found = self.robots_of(cell, None if robot == "*" else robot)
        if len(found) > 1:
            names = ", ".join(each["robot"] for each in found)
            raise InputError(f"the cell {cell} has several robots: {names}; name one of them")
        return cell, str(found[0]["robot"])

    def _give_bundle(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        content = self.roll_outs.content(key.rpartition("/")[2])
        if content is not None:
            query.reply(key, content)

    def _take_presence(self, sample: zenoh.Sample) -> None:
        import zenoh

        cell, instance = parts(str(sample.key_expr))
        here = sample.kind == zenoh.SampleKind.PUT
        with self._lock:
            instances = self._instances.setdefault(cell, set())
            (instances.add if here else instances.discard)(instance)
            if not instances:
                del self._instances[cell]
            for (name, _), tile in self._tiles.items():
                if name == cell:  # this state is the last one of the previous process
                    known = tile.state.instance in instances
                    tile.gone_s = None if known else tile.gone_s or time.monotonic()
        log.info("the cell %s %s", cell, "is connected" if here else "is no longer connected")
        if here:
            # Runs in a new thread, because a callback that waits would block the session.
            threading.Thread(target=self._ask_states, args=(cell,), daemon=True).start()

    def _ask_states(self, cell: str) -> None:
        """Ask a cell for its states, because it may have published them before this hub listened."""
        import zenoh

        with contextlib.suppress(zenoh.ZError):
            for content in payloads(self._session.get(self._keys.of(cell, "*", "state"), timeout=ASK_S)):
                with contextlib.suppress(InputError):
                    state = read(FleetState, content)
                    if state.cell == cell:  # a cell may only answer for itself
                        self._keep(state)

    def _ask_events(self, tile: Tile) -> None:
        """Request the events that a robot has recorded before its first state arrived."""
        import zenoh

        cell, robot, instance = tile.state.cell, tile.state.robot, tile.state.instance
        with contextlib.suppress(zenoh.ZError):
            for content in payloads(self._session.get(self._keys.of(cell, robot, "events"), timeout=ASK_S)):
                with contextlib.suppress(ValidationError, InputError):
                    self._keep_events(_events_in(content, cell, robot))
                    return
        tile.asked.discard(instance)  # the next state causes a new request

    def _take_state(self, sample: zenoh.Sample) -> None:
        try:
            state = read(FleetState, bytes(sample.payload))
            if (state.cell, state.robot) != parts(str(sample.key_expr)):
                raise InputError(
                    f"the state of {state.cell}/{state.robot} arrived under the key {sample.key_expr}"
                )
            self._keep(state)
        except InputError as exc:
            log.warning("a state is ignored: %s", exc)

    def _keep(self, state: FleetState) -> None:
        name = state.cell, state.robot
        with self._lock:
            instances = self._instances.get(state.cell, set())
            if state.instance not in instances:
                return  # late, from a cell that is gone, or from a client that is not a cell
            tile = self._tiles.get(name)
            if tile is None:
                if len(self._tiles) >= MAX_ROBOTS:
                    return
                tile = self._tiles[name] = Tile(state, time.monotonic())
            tile.state, tile.heard_s, tile.gone_s = state, time.monotonic(), None
            if state.instance in tile.asked:
                return
            tile.asked = (tile.asked & instances) | {state.instance}
        # A cell can answer once it publishes states. When the cell appears, it may not answer yet.
        threading.Thread(target=self._ask_events, args=(tile,), daemon=True).start()

    def _take_event(self, sample: zenoh.Sample) -> None:
        try:
            event = read(RobotEvent, bytes(sample.payload))
            if (event.cell, event.robot) != parts(str(sample.key_expr)):
                raise InputError(
                    f"the event of {event.cell}/{event.robot} arrived under the key {sample.key_expr}"
                )
            self._keep_events([event])
        except InputError as exc:
            log.warning("an event is ignored: %s", exc)

    def _keep_events(self, events: Iterable[RobotEvent]) -> None:
        with self._lock:
            for event in events:
                tile = self._tiles.get((event.cell, event.robot))
                if tile is not None:
                    tile.add(event)

    def _shown(self, tile: Tile) -> dict[str, Any]:
        alive = tile.gone_s is None
        shown = tile.state.model_dump()
        if not alive:
            shown["state"] = "gone"
        return shown | {
            "alive": alive,
            "age_s": round(time.monotonic() - tile.heard_s, 2),
            "used_twice": len(self._instances.get(tile.state.cell, ())) > 1,
        }


def _counts(answers: Iterable[CommandAnswer]) -> str:
    codes = [answer.code for answer in answers]
    return ", ".join(f"{codes.count(code)} {code}" for code in sorted(set(codes))) or "no robots"

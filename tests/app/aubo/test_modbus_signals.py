"""Modbus signals.

Oracle: pymodbus's own server, in a process of its own, that can be killed and started again.
"""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, closing
from random import Random
from typing import Any

import pytest
from vendor_calls import Caller, equipped, eventually, run

from cobot.codes import Code

CLASS = "RegisterControl"
SERVER = """
import asyncio, sys, warnings
warnings.simplefilter("ignore")
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.server import StartAsyncTcpServer
block = lambda *values: ModbusSequentialDataBlock(1, list(values))
unit = ModbusDeviceContext(di=block(0, 1, 1), co=block(0, 0, 0), ir=block(17, 65535), hr=block(5, 6, 7))
asyncio.run(StartAsyncTcpServer(
    ModbusServerContext(devices={3: unit}, single=False), address=("127.0.0.1", int(sys.argv[1]))))
"""


class Server:
    """Unit 3 with discrete inputs 0, 1, 1, coils 0, 0, 0, input registers 17, 65535, holding 5, 6, 7."""

    def __init__(self) -> None:
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            self.port = found.getsockname()[1]
        self.start()

    def start(self) -> None:
        self._process = subprocess.Popen([sys.executable, "-c", SERVER, str(self.port)])

    def stop(self) -> None:
        self._process.kill()
        self._process.wait()

    @property
    def where(self) -> str:
        return f"127.0.0.1,{self.port}"


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    made = Server()
    yield made
    made.stop()


@asynccontextmanager
async def asking() -> AsyncIterator[tuple[Caller, Any]]:
    robot = equipped()
    try:
        yield Caller(robot, CLASS), robot.equipment.modbus
    finally:
        robot.equipment.close()


async def add(ask: Caller, where: str, name: str, kind: int, address: int, unit: int = 3) -> None:
    await ask(
        "modbusAddSignal",
        device_info=where,
        slave_number=unit,
        signal_address=address,
        signal_type=kind,
        signal_name=name,
        sequential_mode=False,
    )


def test_signals_of_all_types_are_what_the_device_has(server: Server) -> None:
    async def check() -> None:
        async with asking() as (ask, modbus):
            wanted = {"di": (0, 1, 1), "co": (1, 2, 0), "ir": (2, 1, 65535), "hr": (3, 0, 5)}
            for name, (kind, address, _) in wanted.items():
                await add(ask, server.where, name, kind, address)
            await eventually(lambda: all(not signal.problem for signal in modbus.signals()))
            for name, (_, _, value) in wanted.items():
                assert await ask("modbusGetSignalStatus", signal_name=name) == value
                assert await ask("modbusGetSignalError", signal_name=name) == ""
            assert await ask("modbusGetSignalNames") == list(wanted)
            assert await ask("modbusGetSignalTypes") == [0, 1, 2, 3]
            assert await ask("modbusGetSignalValues") == [1, 0, 65535, 5]
            assert await ask("modbusGetSignalErrors") == [0, 0, 0, 0]

    run(check())


def test_outputs_are_set_and_read_back(server: Server) -> None:
    async def check() -> None:
        async with asking() as (ask, modbus):
            await add(ask, server.where, "valve", 1, 0)
            await add(ask, server.where, "speed", 3, 2)
            await add(ask, server.where, "switch", 0, 0)
            await eventually(lambda: all(not signal.problem for signal in modbus.signals()))
            await ask("modbusSetSignalUpdateFrequency", signal_name="speed", update_frequency=50.0)
            for valve, speed in ((1, 65535), (0, 0), (1, 1234)):
                await ask("modbusSetOutputSignal", signal_name="valve", value=valve)
                await ask("modbusSetOutputSignal", signal_name="speed", value=speed)
                await eventually(
                    lambda v=valve, s=speed: (modbus.value("valve"), modbus.value("speed")) == (v, s)
                )
            await ask.fails("modbusSetOutputSignal", Code.LIMIT, signal_name="valve", value=2)
            await ask.fails("modbusSetOutputSignal", Code.LIMIT, signal_name="speed", value=65536)
            assert "digital_input" in await ask.fails(
                "modbusSetOutputSignal", Code.INPUT, signal_name="switch", value=1
            )

    run(check())


def test_what_the_device_refuses_is_told_and_does_not_hide_the_others(server: Server) -> None:
    async def check() -> None:
        async with asking() as (ask, modbus):
            await add(ask, server.where, "good", 2, 0)
            await add(ask, server.where, "beyond", 2, 900)
            await add(ask, server.where, "stranger", 2, 0, unit=9)
            await eventually(lambda: "has not been read" not in modbus.signal("stranger").problem)
            await eventually(lambda: not modbus.signal("good").problem)
            beyond = await eventually(lambda: modbus.signal("beyond").problem)
            assert "rejects address 900: illegal address (exception 2)" in beyond
            assert (
                await ask.fails("modbusGetSignalStatus", Code.DEVICE, signal_name="beyond")
                == f"beyond: {beyond}"
            )
            assert "unit 9" in await ask("modbusGetSignalError", signal_name="stranger")
            assert await ask("modbusGetSignalStatus", signal_name="good") == 17

    run(check())


def test_a_server_that_dies_is_noticed_and_found_again_when_it_comes_back() -> None:
    async def check() -> None:
        server = Server()
        try:
            async with asking() as (ask, modbus):
                await add(ask, server.where, "level", 3, 0)
                await eventually(lambda: not modbus.signal("level").problem)
                server.stop()
                await eventually(lambda: "not connected" in modbus.signal("level").problem)
                await ask.fails("modbusGetSignalStatus", Code.DEVICE, signal_name="level")
                await ask.fails("modbusSetOutputSignal", Code.DEVICE, signal_name="level", value=1)
                server.start()
                await eventually(lambda: not modbus.signal("level").problem)
                assert await ask("modbusGetSignalStatus", signal_name="level") == 5
        finally:
            server.stop()

    run(check())


def test_a_device_that_never_answers_is_told_and_holds_up_no_other(server: Server) -> None:
    async def check() -> None:
        swallows = []

        async def swallow(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            swallows.append(asyncio.current_task())
            with closing(writer):
                while await reader.read(1000):
                    pass

        mute = await asyncio.start_server(swallow, "127.0.0.1", 0)
        port = mute.sockets[0].getsockname()[1]
        async with mute, asking() as (ask, modbus):
            await add(ask, f"127.0.0.1:{port}", "mute", 2, 0)
            await add(ask, server.where, "good", 2, 0)
            await eventually(lambda: "has not answered within 1 s" in modbus.signal("mute").problem)
            assert await ask("modbusGetSignalStatus", signal_name="good") == 17
            await ask("modbusDeleteAllSignals")
            await asyncio.gather(*swallows)  # Each ends with its connection.

    run(check())


@pytest.mark.parametrize(
    "wrong",
    [
        lambda asked: asked[:2] + b"\0\0\0\3" + asked[6:8] + b"\0",  # no values
        lambda asked: asked[:2] + b"\0\0\0\4" + asked[6:7] + b"\1\1\1",  # coils instead of a register
    ],
)
def test_a_device_that_answers_something_else_is_told_and_asked_again(
    wrong: Callable[[bytes], bytes],
) -> None:
    async def check() -> None:
        def right(asked: bytes) -> bytes:
            return asked[:2] + b"\0\0\0\5" + asked[6:8] + b"\2\0\7"

        answers = iter([wrong])

        async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            try:
                while asked := await reader.read(1000):
                    writer.write(next(answers, right)(asked))
            finally:
                writer.close()

        device = await asyncio.start_server(answer, "127.0.0.1", 0)
        port = device.sockets[0].getsockname()[1]
        async with device, asking() as (ask, modbus):
            await add(ask, f"127.0.0.1:{port}", "odd", 2, 0)
            await eventually(lambda: "does not match the request" in modbus.signal("odd").problem)
            await eventually(lambda: modbus.signal("odd").value == 7 and not modbus.signal("odd").problem)

    run(check())


def test_a_host_name_that_cannot_be_one_is_the_signal_s_problem() -> None:
    async def check() -> None:
        async with asking() as (ask, modbus):
            await add(ask, "a..b", "nowhere", 2, 0)
            await eventually(lambda: "a..b:502 is not connected" in modbus.signal("nowhere").problem)

    run(check())


def test_a_slow_device_is_read_as_often_as_it_answers(server: Server) -> None:
    async def check() -> None:
        delays = []

        async def delay(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            delays.append(asyncio.current_task())
            answers, behind = await asyncio.open_connection("127.0.0.1", server.port)
            with closing(writer), closing(behind):
                while request := await reader.read(1000):
                    behind.write(request)
                    answer = await answers.read(1000)
                    await asyncio.sleep(0.3)
                    writer.write(answer)

        slow = await asyncio.start_server(delay, "127.0.0.1", 0)
        async with slow, asking() as (ask, modbus):
            port = slow.sockets[0].getsockname()[1]
            await add(ask, f"127.0.0.1:{port}", "slow", 3, 1)
            await ask("modbusSetSignalUpdateFrequency", signal_name="slow", update_frequency=100.0)
            await eventually(lambda: not modbus.signal("slow").problem)
            await ask("modbusSetOutputSignal", signal_name="slow", value=77)
            await eventually(lambda: modbus.value("slow") == 77)
            await ask("modbusDeleteAllSignals")
            await asyncio.gather(*delays)  # Each ends with its connection.

    run(check())


def test_deleted_signals_are_gone_with_their_connection(server: Server) -> None:
    async def check() -> None:
        async with asking() as (ask, modbus):
            await add(ask, server.where, "a", 2, 0)
            await add(ask, server.where, "b", 2, 1)
            await ask("modbusDeleteSignal", signal_name="a")
            assert await ask("modbusGetSignalNames") == ["b"]
            assert "valid names: 'b'" in await ask.fails(
                "modbusDeleteSignal", Code.NOT_FOUND, signal_name="a"
            )
            await ask("modbusDeleteAllSignals")
            assert await ask("modbusGetSignalNames") == []
            assert modbus._devices == {}

    run(check())


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"device_info": ""}, Code.INPUT),
        ({"device_info": "host,0"}, Code.INPUT),
        ({"device_info": "host,abc"}, Code.INPUT),
        ({"device_info": "/dev/ttyUSB0"}, Code.NOT_SUPPORTED),
        ({"slave_number": 256}, Code.INPUT),
        ({"signal_address": 65536}, Code.INPUT),
        ({"signal_type": 4}, Code.INPUT),
        ({"signal_name": ""}, Code.INPUT),
    ],
)
def test_a_signal_that_cannot_be_is_refused(wrong: dict[str, Any], code: Code) -> None:
    fields = {"device_info": "127.0.0.1", "slave_number": 1, "signal_address": 0, "signal_type": 0}

    async def check() -> None:
        async with asking() as (ask, modbus):
            await ask.fails("modbusAddSignal", code, **{**fields, "signal_name": "x", **wrong})
            assert modbus.signals() == []

    run(check())


def _framed(asked: bytes, *body: int, number: bytes | None = None, length: int | None = None) -> bytes:
    """An answer to a request, whose head may be wrong."""
    size = len(body) if length is None else length
    return (asked[:2] if number is None else number) + b"\0\0" + size.to_bytes(2, "big") + bytes(body)


MALFORMED: dict[str, Callable[[bytes], bytes]] = {
    "random bytes": lambda asked: Random(5).randbytes(300),
    "HTTP": lambda asked: b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n",
    "one byte": lambda asked: b"\0",
    "half a head": lambda asked: asked[:4],
    "a head alone": lambda asked: _framed(asked, length=5),
    "a length of 0": lambda asked: _framed(asked, length=0),
    "a length of 2": lambda asked: _framed(asked, 3, 4),
    "a length of 65535": lambda asked: _framed(asked, 3, 4, 2, 0, 7, length=0xFFFF),
    "a length that is too large by one": lambda asked: _framed(asked, 3, 4, 2, 0, 7, length=6),
    "a length that is too small by one": lambda asked: _framed(asked, 3, 4, 2, 0, 7, length=4),
    "another transaction": lambda asked: _framed(asked, 3, 4, 2, 0, 7, number=b"\xff\xff"),
    "another protocol": lambda asked: asked[:2] + b"\0\1\0\5\3\4\2\0\7",
    "another unit": lambda asked: _framed(asked, 4, 4, 2, 0, 7),
    "another function": lambda asked: _framed(asked, 3, 3, 2, 0, 7),
    "no function": lambda asked: _framed(asked, 3, 0, 2, 0, 7),
    "no bytes": lambda asked: _framed(asked, 3, 4, 0),
    "fewer bytes than announced": lambda asked: _framed(asked, 3, 4, 2, 7),
    "more bytes than announced": lambda asked: _framed(asked, 3, 4, 2, 0, 7, 7),
    "two registers": lambda asked: _framed(asked, 3, 4, 4, 0, 7, 0, 7),
    "an exception without a code": lambda asked: _framed(asked, 3, 0x84, length=2),
    "an exception of another function": lambda asked: _framed(asked, 3, 0x83, 2),
    "an exception that nobody knows": lambda asked: _framed(asked, 3, 0x84, 0xEE),
    "two answers": lambda asked: 2 * _framed(asked, 3, 4, 2, 0, 9),
    "10 MB": lambda asked: bytes(10_000_000),
}


KNOWN_PROBLEMS = ("does not match the request", "has not answered", "has closed", "exception 238", "reset")


@pytest.mark.parametrize("ends", [False, True])
def test_a_device_may_answer_whatever_it_likes(ends: bool, caplog: pytest.LogCaptureFixture) -> None:
    """With each of these until the signal has said what is wrong, then well: it has the true value then.

    All at once, each by a device of its own. With `ends` it hangs up after that answer.
    """
    counts = dict.fromkeys(MALFORMED, 0)
    problems: dict[str, set[str]] = {name: set() for name in MALFORMED}

    def told(name: str) -> set[str]:
        return problems[name] - {"", "the signal has not been read yet"}

    def device(name: str) -> Callable[[asyncio.StreamReader, asyncio.StreamWriter], Any]:
        async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            try:
                while asked := await reader.read(1000):
                    counts[name] += 1
                    first = counts[name] == 1 or not (name == "two answers" or told(name))
                    writer.write(MALFORMED[name](asked) if first else _framed(asked, 3, 4, 2, 0, 7))
                    await writer.drain()
                    if first and ends:
                        break
            except (OSError, asyncio.CancelledError):  # the test may end before the service has hung up
                pass
            finally:
                writer.transport.abort()

        return answer

    async def check() -> None:
        async with AsyncExitStack() as stack:
            ask, modbus = await stack.enter_async_context(asking())
            for name in MALFORMED:
                server = await asyncio.start_server(device(name), "127.0.0.1", 0)
                stack.push_async_callback(server.wait_closed)
                stack.callback(server.close)
                await add(ask, f"127.0.0.1:{server.sockets[0].getsockname()[1]}", name, 2, 0)

            def all_well() -> bool:
                for name in MALFORMED:
                    problems[name].add(modbus.signal(name).problem)
                return all(
                    modbus.signal(each).value == 7 and not modbus.signal(each).problem for each in counts
                )

            await eventually(all_well)
            for name in MALFORMED:
                for problem in told(name):
                    assert any(words in problem for words in KNOWN_PROBLEMS), (name, problem)
            await ask("modbusDeleteAllSignals")

    run(check())
    assert "Traceback" not in caplog.text
    assert not [record for record in caplog.records if record.name.startswith("asyncio")]

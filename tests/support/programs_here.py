"""Sequences and Lua programs on virtual time, in the test's thread: only that one may run the service."""

from __future__ import annotations

from pathlib import Path

from virtual_service import VirtualService

from cobot.runner.interpreter import Interpreter
from cobot.runner.library import Library
from cobot.runner.lua_program import Program
from cobot.runner.lua_sandbox import LuaLimits
from cobot.runner.progress import Progress
from cobot.runner.schema import read_sequence


def run_sequence(service: VirtualService, file: Path) -> list[str]:
    """Run a sequence file once. Returns its log."""
    lines: list[str] = []
    library, sequence = Library(file.parent), read_sequence(file)
    library.require(sequence, file.name)
    client = service.client(service.url)
    Interpreter(client, library, Progress(None, None), lines.append, clock=service.clock).run(sequence)
    return lines


def run_lua(service: VirtualService, source: str, folder: Path) -> list[str]:
    """Run a Lua program that calls the sequence files of a folder. Returns what it prints."""
    lines: list[str] = []
    client, library = service.client(service.url), Library(folder)
    interpreter = Interpreter(client, library, Progress(None, None), lines.append, clock=service.clock)
    program = Program(
        client, service.url, LuaLimits(), lines.append, call=lambda name: interpreter.call(name, {})
    )
    program._run_in_thread = program._steps._run_in_thread = lambda work: work()  # type: ignore[method-assign]
    program._steps._clock = service.clock
    program._steps._paused_s = lambda: 0.0
    program.run(source.encode(), "program.lua")
    return lines

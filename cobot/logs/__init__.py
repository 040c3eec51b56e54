"""Logging that nobody waits for. Each process has a queue and a thread (`process`), the supervisor reads what
they write and has a queue and a thread for each place where lines end (`supervision`)."""

from cobot.logs.lines import bind, bound, log_context, printable
from cobot.logs.process import dropped, start_logging

__all__ = ["bind", "bound", "dropped", "log_context", "printable", "start_logging"]

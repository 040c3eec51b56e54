"""Logging that never blocks its caller.

Each process has a queue and a thread (`process`). The supervisor reads the lines of all processes. It has a
queue and a thread for each destination (`supervision`).
"""

from cobot.logs.lines import add_ids, bind, log_context, printable
from cobot.logs.process import dropped, start_logging

__all__ = ["add_ids", "bind", "dropped", "log_context", "printable", "start_logging"]

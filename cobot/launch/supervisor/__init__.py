"""`cobot run`: starts rtloop, the service and ros2, restarts what dies, and leaves nothing behind.

A process that has ended is started again, after a pause that doubles up to `MAX_BACKOFF_S`. The supervisor
owns the shared memory and the listening socket, so that both outlive their users: a restarted rtloop finds
where the arm was, and clients that connect while the service restarts wait instead of being refused.
"""

from __future__ import annotations

from cobot.launch.supervisor.supervisor import Supervisor

__all__ = ["Supervisor"]

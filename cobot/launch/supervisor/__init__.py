"""`cobot run`: starts rtloop, the service and ros2, restarts processes that end, and leaves nothing behind.

A process that has ended is started again after a pause, which doubles each time up to `MAX_BACKOFF_S`. The
supervisor owns the shared memory and the listening socket, so that both outlive the processes that use them:
a restarted rtloop finds the arm's last position, and clients that connect while the service restarts wait
instead of being rejected.
"""

from __future__ import annotations

from cobot.launch.supervisor.supervisor import Supervisor

__all__ = ["Supervisor"]

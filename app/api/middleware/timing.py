"""Measures the duration of requests by route and status, for /metrics. Every request passes through this
module, so its code must be fast.
"""

from __future__ import annotations

import time
from bisect import bisect_left
from dataclasses import dataclass, field

from starlette.types import ASGIApp, Message, Receive, Scope, Send

BUCKETS_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)
"""Upper bounds of the buckets, s. Reading the state takes one or two milliseconds, a motion up to a
minute.
"""
NONE = "none"
"""Label for unknown routes and methods, so that clients cannot create new time series by inventing paths."""
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
CANCELLED = 499
"""Status of a request whose client disconnected before the answer, as in nginx."""


@dataclass(slots=True)
class RouteTimes:
    """Durations of the requests with one route, method and status: the number per bucket, and the sum. The
    last bucket has no upper bound.
    """

    counts: list[int] = field(default_factory=lambda: [0] * (len(BUCKETS_S) + 1))
    sum_s: float = 0.0


class RequestTimes:
    """Times of all requests, by (method, route template, status)."""

    def __init__(self) -> None:
        self.times: dict[tuple[str, str, int], RouteTimes] = {}

    def add(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count one request."""
        times = self.times.get((method, route, status))
        if times is None:
            times = self.times[method, route, status] = RouteTimes()
        times.counts[bisect_left(BUCKETS_S, seconds)] += 1
        times.sum_s += seconds


class RequestTiming:
    """ASGI middleware that measures each request."""

    def __init__(self, app: ASGIApp, times: RequestTimes) -> None:
        self._app = app
        self._times = times

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun_s = time.perf_counter()
        status = CANCELLED

        async def send_and_watch(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, send_and_watch)
        except Exception:
            status = 500  # an outer middleware sends this answer
            raise
        finally:
            route = getattr(scope.get("route"), "path", NONE)
            method = scope["method"] if scope["method"] in METHODS else NONE
            self._times.add(method, route, status, time.perf_counter() - begun_s)

"""HTTP requests to the service: decodes its JSON answers and raises its errors as `CobotError`."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import httpx2

from cobot.addresses import DEFAULT_URL, PREFER, STRICT_STATUS, address, check_url, path_at
from cobot.client.tls import Verify, advice, tls_context, token_from_environment, token_header
from cobot.errors import BY_CODE, CobotError, ExecutionError, InputError, UnavailableError
from cobot.folders import open_new

MOTION_TIMEOUT_S = 100.0
"""Timeout for the answer to a motion, in seconds. It is longer than the service's default timeouts, after
which the service waits a few seconds for the arm to stop.
"""
LONG_TIMEOUTS_S = {"/robot/move/sequence": 630.0, "/recordings": 150.0}
"""Minimum timeouts, s, for paths whose answer may take longer than one motion."""
Json = dict[str, Any]


ERRORS = BY_CODE
"""The error class for each code of the service."""


def _error_of(answer: Json) -> CobotError:
    """The error that an answer reports. Raises KeyError if the answer reports no error."""
    if "success" in answer:  # the answer to a motion that did not reach its goal
        error = ERRORS.get(str(answer.get("code")), ExecutionError)(str(answer["message"]))
    else:
        error = ERRORS.get(str(answer["code"]), CobotError)(str(answer["detail"]))
    error.explain = answer.get("explain")
    error.details = answer.get("details") or {}
    return error


class Connection:
    """HTTP connection to the service of one robot. It raises the service's errors as `CobotError`. `Client`
    describes the arguments.
    """

    def __init__(
        self,
        url: str = DEFAULT_URL,
        *,
        robot: str | None = None,
        timeout_s: float = 10.0,
        motion_timeout_s: float = MOTION_TIMEOUT_S,
        token: str | None = None,
        verify: Verify = True,
        motion_token: str | None = None,
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        check_url(url)
        if robot is not None:
            url = address(url, robot)
        headers = token_header(token or token_from_environment())
        headers |= {"X-Motion-Token": motion_token} if motion_token else {}
        # Creating a TLS context with the computer's certificates takes 10 ms, so it is only created if
        # needed.
        trusted = tls_context(verify) if url.startswith("https:") else False
        try:
            # trust_env=False: motions must not go through the web proxy that the environment names.
            self._http = httpx2.Client(
                base_url=url,
                timeout=timeout_s,
                headers=headers,
                verify=trusted,
                transport=transport,
                trust_env=False,
            )
        except httpx2.InvalidURL as exc:
            raise InputError(f"url {url!r}: {exc}") from exc
        self._motion_timeout_s = motion_timeout_s

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def _post_motion(self, path: str, body: Json) -> Json:
        """Send a motion and wait until it has ended. Raises an error if the motion does not reach its
        goal.
        """
        strict = {PREFER: STRICT_STATUS}
        answer = self._json("POST", path, json=body, timeout=self._answer_timeout_s(path), headers=strict)
        if not answer["success"]:  # a proxy has removed the header
            raise _error_of(answer)
        return answer

    def _answer_timeout_s(self, path: str) -> float:
        return max(self._motion_timeout_s, LONG_TIMEOUTS_S.get(path, 0.0))

    def _page(self, path: str, limit: int | None, after: str | None, **query: Any) -> Any:
        """A page of a list; see docs/conventions.md."""
        given = {"limit": limit, "after": after, **query}
        params = {name: value for name, value in given.items() if value is not None}
        return self._request("GET", path, params=params)

    def _json(self, method: str, path: str, **request: Any) -> Json:
        answer = self._request(method, path, **request)
        if not isinstance(answer, dict):
            raise UnavailableError(
                f"{method} {self._url(path)}: the answer does not come from cobot; check the URL"
            )
        return answer

    def _url(self, path: str) -> str:
        if "://" in path:
            return path
        base = str(self._http.base_url).rstrip("/")
        return base + path_at(base, path)

    def _fetch(self, path: str, file: Path) -> None:
        """Write the answer to a file. The file appears only when it is complete.

        Raises:
            InputError: the file cannot be written.
        """
        url, part = self._url(path), file.with_name(f"{file.name}.part")
        try:
            with self._stream(path) as response, open_new(part) as out:
                for piece in response.iter_bytes():
                    out.write(piece)
            part.replace(file)
        except httpx2.HTTPError as exc:
            raise UnavailableError(f"GET {url}: {str(exc) or type(exc).__name__}") from exc
        except OSError as exc:
            raise InputError(f"{file}: cannot be written: {exc.strerror}") from exc
        finally:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)

    def _request(self, method: str, path: str, **request: Any) -> Any:
        url = self._url(path)
        try:
            response = self._http.request(method, url, **request)
        except httpx2.HTTPError as exc:
            raise UnavailableError(f"{method} {url}: {str(exc) or type(exc).__name__}{advice(exc)}") from exc
        except (TypeError, ValueError) as exc:  # JSON has no NaN, no infinity and no Python objects
            raise InputError(f"{method} {path}: {exc}") from exc
        return self._decoded(method, url, response)

    @contextlib.contextmanager
    def _stream(self, path: str, **request: Any) -> Iterator[httpx2.Response]:
        """Context manager for reading an answer while it arrives. Opening it
        raises the errors of `_request`; reading may raise httpx2's errors.
        """
        url = self._url(path)
        with self._http.stream("GET", url, **request) as response:
            if not response.is_success:
                response.read()
                self._decoded("GET", url, response)
            yield response

    def _decoded(self, method: str, url: str, response: httpx2.Response) -> Any:
        try:
            answer = response.json()
            if response.is_success:
                return answer
            error = _error_of(answer)
        except (ValueError, KeyError, TypeError) as exc:
            raise UnavailableError(
                f"{method} {url}: status {response.status_code}, the answer does not come from cobot; "
                "check the URL"
            ) from exc
        raise error

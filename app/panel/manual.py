"""The manual at `/manual`, as built by `make docs`. Its search works without a network.

The pages are static files in this package, and are the same for every robot.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import RedirectResponse
from starlette.types import Receive, Scope, Send

from app.panel.pages import Site, page_headers
from cobot.addresses import MANUAL
from cobot.errors import NotFoundError

SITE = Path(__file__).parent / "manual_site"
NOT_BUILT = (
    "the manual is not built in this installation: run `make docs` in the clone, then load this page again. "
    "The same pages are in the clone's folder docs/"
)
_INLINE = re.compile(rb"<script>(.*?)</script>", re.DOTALL)


def inline_scripts(site: Path) -> Iterator[str]:
    """Yield the hashes of the pages' inline scripts, for a Content-Security-Policy."""
    for body in {body for page in site.glob("*.html") for body in _INLINE.findall(page.read_bytes())}:
        yield f"'sha256-{base64.b64encode(hashlib.sha256(body).digest()).decode()}'"


class _Manual:
    """Serves the last build of the site, or an error if it was never built."""

    def __init__(self, site: Path) -> None:
        self._site = site
        self._built_ns = 0
        self._files: Site | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        files = await asyncio.to_thread(self._newest)
        await files(scope, receive, send)

    def _newest(self) -> Site:
        try:
            built_ns = (self._site / "index.html").stat().st_mtime_ns
        except OSError:
            raise NotFoundError(NOT_BUILT) from None
        if self._files is None or built_ns != self._built_ns:
            headers = page_headers(
                sorted(inline_scripts(self._site)), ["'unsafe-inline'"]
            )  # the search uses inline styles
            self._files, self._built_ns = Site(headers, directory=self._site, html=True), built_ns
        return self._files


def install(app: FastAPI) -> None:
    """Serve the manual."""

    @app.get(MANUAL, include_in_schema=False)
    async def manual() -> RedirectResponse:
        return RedirectResponse(f"{MANUAL}/")

    app.mount(f"{MANUAL}/", _Manual(SITE))

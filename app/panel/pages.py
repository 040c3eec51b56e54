"""The operator panel at `/`: files that are served as they are, and three.js out of the package nicegui.

They are plain ES modules, without a build. three.js is in the browser's component of nicegui, whose file is
served from where that package is installed; the package itself is not imported.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import FileResponse
from starlette.staticfiles import StaticFiles
from starlette.types import Message, Receive, Scope, Send

from app.api.roles import PANEL, THREE
from cobot.errors import NotFoundError

SITE = Path(__file__).parent / "site"
THREE_IN_NICEGUI = Path("elements", "scene", "dist", "index.js")
POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",  # a browser asks whether its copy is still the newest
}


class _Site(StaticFiles):
    """With `HEADERS`."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                added = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
                message = {**message, "headers": [*message.get("headers", ()), *added]}
            await send(message)

        await super().__call__(scope, receive, sent)


def three_file() -> Path:
    """Where three.js is.

    Raises:
        NotFoundError: nicegui is not installed, or has it no more.
    """
    spec = find_spec("nicegui")
    for folder in (spec and spec.submodule_search_locations) or ():
        file = Path(folder) / THREE_IN_NICEGUI
        if file.is_file():
            return file
    raise NotFoundError(
        f"there is no three.js: nicegui, which brings it as {THREE_IN_NICEGUI}, is not installed; "
        "the panel works without the picture of the arm"
    )


def install(app: FastAPI) -> None:
    """Serve the panel."""

    @app.get("/", include_in_schema=False)
    async def panel() -> FileResponse:
        return FileResponse(SITE / "index.html", headers=HEADERS)

    @app.get(THREE, include_in_schema=False)
    async def three() -> FileResponse:
        return FileResponse(three_file(), media_type="text/javascript", headers=HEADERS)

    app.mount(PANEL, _Site(directory=SITE))

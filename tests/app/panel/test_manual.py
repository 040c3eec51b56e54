"""The manual before it is built, and when it is built anew while the service runs."""

from __future__ import annotations

import asyncio
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI

from app.main import create_app
from app.panel import manual
from cobot.config import Settings


@pytest.fixture
def app(settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FastAPI:
    monkeypatch.setattr(manual, "SITE", tmp_path / "site")
    return create_app(settings, None, "http://robot.test")


def ask(app: FastAPI, path: str) -> httpx.Response:
    async def asking() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://robot.test") as client:
            return await client.get(path)

    return asyncio.run(asking())


def test_a_manual_that_is_not_built_says_how_it_is(app: FastAPI) -> None:
    for path in ("/manual/", "/manual/panel.html"):
        answer = ask(app, path)
        assert answer.status_code == 404
        assert answer.json() == {"code": "not_found", "detail": manual.NOT_BUILT}


def test_a_manual_that_is_built_anew_is_served_with_its_own_scripts_allowed(app: FastAPI) -> None:
    for text in ("one", "another"):
        manual.SITE.mkdir(exist_ok=True)
        (manual.SITE / "index.html").unlink(missing_ok=True)
        (manual.SITE / "index.html").write_text(f"<script>{text}()</script>", encoding="utf-8")
        answer = ask(app, "/manual/")
        assert text in answer.text
        (allowed,) = manual.inline_scripts(manual.SITE)
        assert allowed in answer.headers["content-security-policy"]

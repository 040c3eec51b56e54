"""Services that agents come to."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from mcp_agent import FENCE, Cell
from virtual_service import VirtualService, virtual_service


@pytest.fixture(scope="module")
def fenced(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    """Tokens are needed, and motions within the fence may be run."""
    folder = tmp_path_factory.mktemp("fenced")
    more = f"web: {{authentication: required, tokens: {folder / 'tokens.json'}}}\n{FENCE}"
    with virtual_service(folder, more=more) as started:
        yield started


@pytest.fixture(scope="module")
def cell(fenced: VirtualService) -> Cell:
    return Cell(fenced)

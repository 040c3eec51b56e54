"""A robot as a client of the vendor services sees it."""

from __future__ import annotations

from typing import Any

import numpy as np


class VendorArm:
    """One robot over HTTP. The client is an `httpx.Client` or a `VirtualService`."""

    def __init__(self, client: Any, name: str) -> None:
        self.name = name
        self._client = client

    def answer(self, method: str, **fields: Any) -> dict[str, Any]:
        response = self._client.post(f"/{self.name}/{method}", json=fields)
        assert response.status_code == 200, response.text
        found: dict[str, Any] = response.json()
        return found

    def ask(self, method: str, **fields: Any) -> Any:
        found = self.answer(method, **fields)
        assert found["code"] == 0, f"{method}: {found}"
        return found["result"]

    def fails(self, method: str, code: int, **fields: Any) -> str:
        found = self.answer(method, **fields)
        assert found["code"] == code, f"{method}: {found}"
        return str(found["message"])

    @property
    def state(self) -> str:
        return str(self.ask("RuntimeMachine/getRuntimeState"))

    @property
    def joints(self) -> np.ndarray:
        return self._get()["position"]

    @property
    def speed(self) -> float:
        return float(np.abs(self._get()["velocity"]).max())

    def _get(self) -> dict[str, np.ndarray]:
        response = self._client.get(f"/robots/{self.name}/joint_states")
        response.raise_for_status()
        return {name: np.array(response.json()[name]) for name in ("position", "velocity")}

    def home(self) -> None:
        self._client.post(f"/robots/{self.name}/stop").raise_for_status()
        self._client.post(f"/robots/{self.name}/reset").raise_for_status()
        there = self._client.post(f"/robots/{self.name}/move/named", json={"name": "home", "speed": 1.0})
        assert there.json()["success"], there.text

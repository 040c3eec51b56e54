"""Bundles of a cell whose service is a dictionary. Oracle: docs/fleet.md, "Roll out"."""

from __future__ import annotations

import errno
import json
from base64 import b64encode
from pathlib import Path
from typing import Any, cast

import pytest

from cobot.access.roles import Role
from cobot.client import Client
from cobot.config import load_settings, load_with_rolled_out
from cobot.errors import ConflictError, InputError, PermissionDenied, UnavailableError
from cobot.fleet import bundles, cell_settings
from cobot.fleet.bundle import hash_of
from cobot.fleet.bundles import Installed, RobotBundles

OWN = "kept: kept\nfleet: {connect: [tcp/127.0.0.1:7447], accept: {roll_out: admin, settings: admin}}\n"


class Service:
    """The service of a cell: it reloads its settings unless it has a reason not to."""

    def __init__(self, config: Path) -> None:
        self.config, self.source = config, config
        self.refuses: BaseException | None = None
        self.needs_restart: list[str] = []
        self.taught: dict[str, list[float]] = {}
        self.sent: dict[str, bytes] = {}
        self.workers = load_with_rolled_out(config).planning.workers

    def fetch_bundle(self, name: str) -> bytes | None:
        return self.sent.get(name)

    def send(self, version: str, **parts: Any) -> str:
        content = json.dumps({"name": "seams", "version": version, **parts}).encode()
        self.sent[hash_of(content)] = content
        return hash_of(content)

    def reload(self) -> dict[str, list[str]]:
        if self.refuses is not None:
            raise self.refuses
        self.workers = load_with_rolled_out(self.config).planning.workers
        return {"taken_over": [], "needs_restart": self.needs_restart}

    def jobs(self, *_: Any) -> list[Any]:
        return []

    def programs(self) -> list[Any]:
        return []

    def positions(self) -> list[dict[str, Any]]:
        return [
            {"name": name, "joints": joints, "label": "", "description": "", "taught": True}
            for name, joints in self.taught.items()
        ]

    def teach_position(self, name: str, joints: list[float], *_: str, **__: str) -> None:
        self.taught[name] = joints

    def forget_position(self, name: str) -> None:
        self.taught.pop(name, None)


@pytest.fixture
def service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Service:
    monkeypatch.setattr(cell_settings, "_check", lambda *_: None)  # a process, which takes seconds
    config = tmp_path / "cobot-setting.yaml"
    config.write_text(OWN)
    return Service(config)


@pytest.fixture
def own(service: Service) -> RobotBundles:
    return bundles_of(service)


def bundles_of(service: Service) -> RobotBundles:
    """As a process of the cell that starts."""
    return RobotBundles(load_settings(service.config), cast(Client, service), service)


def workers(count: int) -> list[dict[str, str]]:
    content = f"planning: {{workers: {count}}}\n".encode()
    return [{"path": "settings.yaml", "base64": b64encode(content).decode()}]


def position(angle: float) -> list[dict[str, Any]]:
    return [{"name": "seam", "joints": [angle] * 7}]


def roll_out(own: RobotBundles, name: str) -> str:
    own.stage(name, Role.ADMIN)
    return own.activate(name, Role.ADMIN)


def test_settings_stay_in_force_under_a_later_bundle_without_settings(
    service: Service, own: RobotBundles
) -> None:
    roll_out(own, service.send("1", settings=workers(3)))
    later = service.send("2", positions=position(0.1))
    roll_out(own, later)
    assert load_with_rolled_out(service.config).planning.workers == 3
    own.roll_back(later, Role.ADMIN)
    assert load_with_rolled_out(service.config).planning.workers == 3


def test_two_bundles_are_rolled_back_in_the_order_in_which_they_came(
    service: Service, own: RobotBundles
) -> None:
    first, second = (service.send(str(count), settings=workers(count)) for count in (3, 4))
    roll_out(own, first)
    roll_out(own, second)
    with pytest.raises(Exception, match="is not the latest one here; nothing was changed"):
        own.roll_back(first, Role.ADMIN)
    assert service.workers == 4
    own.roll_back(second, Role.ADMIN)
    assert service.workers == 3


def test_settings_are_rolled_back_only_with_the_role_that_may_change_them(
    service: Service, own: RobotBundles
) -> None:
    """Else an operator could take back limits that an administrator has rolled out."""
    name = service.send("1", settings=workers(3))
    roll_out(own, name)
    with pytest.raises(PermissionDenied, match="accepts settings from admin"):
        own.roll_back(name, Role.OPERATOR)
    assert service.workers == 3
    own.roll_back(name, Role.ADMIN)
    assert service.workers == 2


def test_a_rollback_that_needs_a_restart_is_shown_until_that_restart(
    service: Service, own: RobotBundles, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the answer of the service to the reload, and the number of the supervisor's process."""
    name = service.send("1", settings=workers(3))
    roll_out(own, name)
    assert own.restart == ""
    service.needs_restart = ["planning.workers: 3 → 2"]
    assert "restart the cell for: planning.workers" in own.roll_back(name, Role.ADMIN)
    told = "the rollback of seams 1 needs a restart of this cell: planning.workers: 3 → 2"
    assert own.restart == told
    assert bundles_of(service).restart == told, "also after a kill of the cell's process alone"
    roll_out(own, service.send("2", positions=position(0.1)))
    assert own.restart == told, "a bundle without settings changes nothing about it"
    monkeypatch.setattr("os.getppid", lambda: -1)
    assert bundles_of(service).restart == ""
    service.needs_restart = []
    roll_out(own, service.send("3", settings=workers(4)))
    assert not load_settings(service.config).restart_file.exists()


def test_a_service_that_refuses_a_reload_leaves_all_as_it_was(service: Service, own: RobotBundles) -> None:
    first = service.send("1", settings=workers(3), positions=position(0.1))
    roll_out(own, first)
    service.refuses = ConflictError("the arm is under the control of ada")
    second = service.send("2", settings=workers(4), positions=position(0.2))
    with pytest.raises(ConflictError, match=r"under the control of ada; nothing has changed$"):
        roll_out(own, second)
    service.refuses = None
    assert own.title == f"seams 1 ({first[:8]})"
    assert (service.reload() and service.workers, service.taught["seam"][0]) == (3, 0.1)
    own.roll_back(first, Role.ADMIN)
    assert (service.workers, service.taught) == (2, {})


def test_an_interrupted_bundle_is_undone_before_the_next_one(service: Service) -> None:
    """Else the next one would remember half of it as what was there before."""
    begun = Installed(
        bundle="0" * 64,
        title="half 1",
        versions={},
        programs_before={},
        positions_before={"seam": None},
        complete=False,
    )
    service.taught["seam"] = [9.0] * 7  # by the one that was interrupted
    load_settings(service.config).bundle_file.parent.mkdir()
    load_settings(service.config).bundle_file.write_text(begun.model_dump_json())
    own = bundles_of(service)
    name = service.send("2", positions=position(0.2))
    roll_out(own, name)
    own.roll_back(name, Role.ADMIN)
    assert service.taught == {}


def test_the_same_settings_again_never_leave_their_folder_empty(
    service: Service, own: RobotBundles, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that is killed at any moment leaves settings that can be read."""
    name = service.send("1", settings=workers(3), positions=position(0.1))
    roll_out(own, name)
    found = []
    write = cell_settings._write

    def watched(folder: Path, files: Any) -> None:
        found.append(load_with_rolled_out(service.config).planning.workers)
        write(folder, files)

    monkeypatch.setattr(cell_settings, "_write", watched)
    own._own.activate(name, bundles.read_bundle(service.sent[name]).settings)
    assert found == [3]


def test_a_bundle_that_was_changed_on_its_way_is_refused(service: Service, own: RobotBundles) -> None:
    name = service.send("1", positions=position(0.1))
    service.sent[name] = service.sent[name].replace(b"0.1", b"0.9")
    with pytest.raises(
        InputError,
        match=r"does not belong to the bundle [0-9a-f]{8}: its hash "
        r"differs; send the bundle again",
    ):
        own.stage(name, Role.ADMIN)
    assert service.taught == {}


def test_a_file_and_a_folder_of_one_name_are_named_without_a_path_of_this_computer(
    service: Service, own: RobotBundles
) -> None:
    files = [*workers(3), *({"path": path, "base64": ""} for path in ("meshes/arm/base.stl", "meshes/arm"))]
    with pytest.raises(InputError) as caught:
        own.stage(service.send("1", settings=files), Role.ADMIN)
    assert str(caught.value) == (
        "the bundle has a file 'meshes/arm', which is also the folder of the file "
        "'meshes/arm/base.stl'; rename one of them"
    )


@pytest.mark.parametrize("parts", [{"settings": workers(3)}, {"positions": position(0.1)}])
def test_a_full_disk_is_an_error_before_anything_changes(
    service: Service, own: RobotBundles, monkeypatch: pytest.MonkeyPatch, parts: dict[str, Any]
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tempfile.mkdtemp", full)
    with pytest.raises(UnavailableError, match="full"):
        own.stage(service.send("1", **parts), Role.ADMIN)
    assert (service.workers, service.taught) == (2, {})


def test_settings_of_a_process_that_was_killed_before_the_reload_are_taken_back(
    service: Service, own: RobotBundles
) -> None:
    """The state on disk is what a kill leaves between the link and the reload."""
    name = service.send("1", settings=workers(3))
    own.stage(name, Role.ADMIN)
    service.refuses = SystemExit()
    with pytest.raises(SystemExit):
        own.activate(name, Role.ADMIN)
    service.refuses = None
    service.reload()  # as a start of the whole cell
    assert service.workers == 3
    bundles_of(service).recover()
    assert service.workers == 2
    assert not load_settings(service.config).rolled_out.exists()

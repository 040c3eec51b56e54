"""A Python client of the REST service.

    with Client("http://localhost:8007") as robot:
        robot.move_joints([0.0, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], speed=0.5)

Answers are the service's decoded JSON. An error from the service is raised as the same subclass of
`CobotError` that the service uses: an unreachable pose raises `UnreachableError`.
"""

from __future__ import annotations

import base64
import contextlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from cobot.addresses import CONTROL_TOKEN, service_of
from cobot.client.connection import Json
from cobot.client.events import EventConnection
from cobot.client.force import ForceMoves
from cobot.client.gripper import GripperCommands
from cobot.client.steps import Steps
from cobot.errors import CobotError, InputError, UnavailableError

RELOAD_S = 60.0
PICTURE_S = 30.0
STOP_TRIES, STOP_TIMEOUT_S = 3, 15.0


class Client(ForceMoves, Steps, EventConnection):
    """A client for the service of one robot.

    Args:
        url: service URL, for its default robot, or of one of its robots: http://HOST:PORT/robots/NAME.
        robot: robot name, if it is not the default one.
        timeout_s: timeout for all requests that are answered immediately.
        motion_timeout_s: timeout for motions, which are answered when they end. It is longer than the
            service's own timeouts. Some answers take longer: see `cobot.client.connection.LONG_TIMEOUTS_S`.
        token: access token, made with `cobot token create`, if the service requires one; by default
            `COBOT_TOKEN`.
        verify: which certificates to trust, see `cobot.client.tls.tls_context`.
        motion_token: token that a sequence uses for its own motions.

    Raises (constructor):
        InputError: the URL is invalid.

    Every method raises:
        UnavailableError: the service or the robot behind it does not answer.
        CobotError: the error that the service reports; its `code` determines the class.
    """

    @property
    def gripper(self) -> GripperCommands:
        """Commands to the gripper."""
        return GripperCommands(self)

    def joint_states(self) -> Json:
        """The measured joints: `name`, `position` (rad), `velocity` (rad/s), `effort` (N·m)."""
        return self._json("GET", "/robot/joint_states")

    def pose(self) -> Json:
        """The TCP pose: `position` (m), `orientation`, `frame_id`."""
        return self._json("GET", "/robot/pose")

    def state(self) -> Json:
        """The whole state block: `mode`, `reason`, measured and commanded joints, the TCP, the motion, the
        session and counters. The service's page `/docs` describes units and meanings.
        """
        return self._json("GET", "/robot/state")

    def picture(self, view: str = "iso") -> bytes:
        """A picture of the arm, its tool and its surroundings, as PNG.

        Args:
            view: "iso", "front", "side" or "top".
        """
        with self._stream("/robot/picture", params={"view": view}, timeout=PICTURE_S) as response:
            return response.read()

    def positions(self, limit: int | None = None, after: str | None = None) -> list[Json]:
        """The named positions.

        Args (of every list):
            limit: maximum number of entries; None means all of them, or as many as the service sends by
                default.
            after: id or name of an entry in an earlier answer; the list continues after this entry.
        """
        return list(self._page("/robot/positions", limit, after))

    def teach_position(
        self, name: str, joints: Sequence[float] | None = None, description: str = "", label: str = ""
    ) -> Json:
        """Save a named position with the given joint angles (rad), or with the current ones if none are
        given.

        Args:
            name: name in programs: letters, digits and _ . -
            label: displayed name, in any language; with "", `name` is displayed.
        """
        body: Json = {"name": name, "description": description}
        if label:
            body["label"] = label
        if joints is not None:
            body["joints"] = list(joints)
        return self._json("POST", "/robot/positions", json=body)

    def forget_position(self, name: str) -> None:
        """Remove a named position that was saved."""
        self._request("DELETE", f"/robot/positions/{name}")

    def plan(self, what: str, **request: Any) -> Json:
        """Plan without moving. Returns `plan_id`, `duration_s`, the path, the utilisation of the limits,
        distances and torques.

        Args:
            what: "named", "joints", "pose", "arc", "path" or "sequence".
            request: the body of POST /robot/plan/{what}, which contains the fields of the motion, `start` and
                `samples`.
        """
        return self._json("POST", f"/robot/plan/{what}", json=request, timeout=self._motion_timeout_s)

    def improve(self, plan_id: str, budget_s: float = 1.0, samples: int = 50) -> Json:
        """Search for a faster plan with the same start and goal for `budget_s` seconds. Returns the faster
        plan, or the same plan if none is found.

        `planning.quality` is "improved", or "final" if more time does not help.
        """
        path = f"/robot/plans/{quote(plan_id, safe='')}/improve"
        body = {"budget_s": budget_s, "samples": samples}
        return self._json("POST", path, json=body, timeout=self._motion_timeout_s)

    def rehearse(self, plan_id: str) -> Json:
        """Dry run of a plan on a simulated copy of the robot. The real arm does not move. Returns
        `runs_through`, `problem`, `effort`.
        """
        path = f"/robot/plans/{quote(plan_id, safe='')}/rehearse"
        return self._json("POST", path, timeout=self._motion_timeout_s)

    def tool(self) -> Json:
        """The tool: `version`, `name`, `mass`, `centre`, `inertia`, `position` and `quaternion` of the TCP,
        `shapes`, `gravity`.
        """
        return self._json("GET", "/robot/tool")

    def set_tool(self, **changes: Any) -> Json:
        """Set the tool while the arm does not move. Fields that are not given stay unchanged.

        Args:
            changes: `clear`, `name`, `mass`, `centre`, `inertia`, `tcp`, `shapes`, `gravity`, as in POST
                /robot/tool.
        """
        return self._json("POST", "/robot/tool", json=changes)

    def calibrate_tool(self, points: Sequence[Sequence[float]]) -> Json:
        """Compute the TCP from joint positions in which the tip of the tool touches one fixed point. This
        does not change the tool. Returns the `position` of the TCP in the flange's frame, `point`, `error_m`
        and `errors_m`.

        Args:
            points: 4 to 20 joint positions, rad.
        """
        return self._json("POST", "/robot/tool/calibrate", json={"points": [list(each) for each in points]})

    def scene(self) -> Json:
        """The scene: `version`, `objects`, `frames` and `allowed` pairs."""
        return self._json("GET", "/scene")

    def change_scene(self, **changes: Any) -> Json:
        """Change the scene, completely or not at all. Returns `version`, `stopped`, `contacts`.

        Args:
            changes: `clear`, `detach`, `frames`, `objects`, `move`, `attach` and `allowed`, as in POST
                /scene. The `points` of a point cloud may be a numpy array, which is sent in compact form.
        """
        if objects := changes.get("objects"):
            changes["objects"] = {name: solid and _compact(solid) for name, solid in objects.items()}
        return self._json("POST", "/scene", json=changes)

    def put_object(self, name: str, shape: str, **solid: Any) -> Json:
        """Add an object to the scene, or replace it.

        Args:
            shape: "box", "sphere", "cylinder", "capsule", "mesh", "height_field" or "point_cloud".
            solid: fields of the shape: `size`, or `radius` and `length`, m, or the `file` of a mesh as
                base64, or the `points` of a point cloud (a list, or a numpy array of shape (n, 3)) and its
                `voxel`; `x`, `y`, `z`, `a`, `b`, `c` and `frame_id`; `mass`, kg.
        """
        return self.change_scene(objects={name: {"shape": shape, **solid}})

    def remove_object(self, name: str) -> Json:
        """Remove an object from the scene."""
        return self.change_scene(objects={name: None})

    def attach_object(self, name: str, touch: Sequence[str] = ()) -> Json:
        """Attach an object to the hand. It may touch the bodies and objects named in `touch`."""
        return self.change_scene(attach={name: list(touch)})

    def detach_object(self, name: str) -> Json:
        """Detach an object from the hand. It stays at its current pose."""
        return self.change_scene(detach=[name])

    def send_trajectory(self, points: Sequence[Mapping[str, Any]], **options: bool) -> Json:
        """Run timed points. Returns when the motion has begun. `options` are the options of POST
        /trajectory/send.
        """
        body = {"points": [dict(point) for point in points], **options}
        return self._json("POST", "/trajectory/send", json=body, timeout=self._motion_timeout_s)

    def send_csv(self, path: str | Path, *, separator: str | None = None, **options: bool) -> Json:
        """Run timed points from a CSV file. Returns when the motion has begun.

        Args:
            separator: None to detect it from the header.
        """
        with Path(path).open("rb") as file:
            return self._json(
                "POST",
                "/trajectory/send_csv",
                params=options if separator is None else {"separator": separator, **options},
                files={"file": (Path(path).name, file, "text/csv")},
                timeout=self._motion_timeout_s,
            )

    def trajectory_logs(self, limit: int | None = 50, after: str | None = None) -> list[str]:
        """Results of trajectories; the newest line is last."""
        return list(self._page("/trajectory/logs", limit, after)["lines"])

    def recordings(self, limit: int | None = None, after: str | None = None) -> Json:
        """The stored `recordings`, newest first, and the state of the `recorder`."""
        return dict(self._page("/recordings", limit, after))

    def record(self, action: str = "dump", seconds: float | None = None) -> list[str]:
        """Write the last seconds to a file ("dump"), or "start" or "stop" a continuous recording.

        Returns:
            The file names; for "start", the beginning of the names.
        """
        body, path = {"action": action, "seconds": seconds}, "/recordings"
        return list(self._json("POST", path, json=body, timeout=self._answer_timeout_s(path))["names"])

    def fetch_recording(self, name: str, path: str | Path) -> None:
        """Download a recording to a local file."""
        self._fetch(f"/recordings/{quote(name, safe='')}", Path(path))

    def remove_recording(self, name: str) -> None:
        """Permanently delete a recording that the service stores."""
        self._json("DELETE", f"/recordings/{quote(name, safe='')}")

    def fetch_backup(self, path: str | Path) -> None:
        """Write a backup to a local file. It contains settings, tool, scene, taught positions and stored
        programs.
        """
        self._fetch(self._of_service("/admin/backup"), Path(path))

    def fetch_support(self, path: str | Path) -> None:
        """Write a support bundle to a local file. It contains the settings without secrets, versions, health
        and logs.
        """
        self._fetch(self._of_service("/admin/support"), Path(path))

    def restore(self, path: str | Path) -> Json:
        """Check a backup now, and restore it at the next start of cobot. Returns `created`, `contents`."""
        with Path(path).open("rb") as file:
            return self._json(
                "POST", self._of_service("/admin/restore"), files={"file": (Path(path).name, file)}
            )

    def access_tokens(self) -> Json:
        """The access `tokens` with their names, roles and times; `required`, and a `hint` if none can be
        created.
        """
        return self._json("GET", self._of_service("/access/tokens"))

    def create_access_token(self, name: str, role: str, days: float | None = None) -> Json:
        """Create an access token. The client must be an administrator. Only this answer contains the token
        itself, as `token`.

        Args:
            name: name of a person or a program.
            role: "observer", "agent", "operator", "programmer" or "admin".
            days: lifetime; None for a token that never expires.
        """
        body = {"name": name, "role": role} | ({} if days is None else {"days": days})
        return self._json("POST", self._of_service("/access/tokens"), json=body)

    def delete_access_token(self, name: str, own: bool = False) -> Json:
        """Delete an access token. It becomes invalid immediately.

        Args:
            own: delete it even if it is the token of this client.
        """
        params = {"own": "true"} if own else {}
        path = self._of_service(f"/access/tokens/{quote(name, safe='')}")
        return self._json("DELETE", path, params=params)

    def reload(self) -> Json:
        """Make the service read the settings files again. `taken_over` and `needs_restart` list the
        changes.
        """
        return self._json("POST", self._of_service("/admin/reload"), timeout=RELOAD_S)

    def start_sequence(self, path: str | Path, **options: str | float) -> Json:
        """Start a sequence file. `options` are the options of POST /sequences/start."""
        with Path(path).open("rb") as file:
            return self._json(
                "POST",
                "/sequences/start",
                files={"config": (Path(path).name, file, "application/json")},
                data={name: str(value) for name, value in options.items()},
            )

    def sequence_status(self) -> Json:
        """The state of the newest sequence."""
        return self._json("GET", "/sequences/status")

    def sequence_logs(self, limit: int | None = 50, after: str | None = None) -> list[str]:
        """Output of the runner; the newest line is last."""
        return list(self._page("/sequences/logs", limit, after)["lines"])

    def programs(self, limit: int | None = None, after: str | None = None) -> list[Json]:
        """The stored programs, each with its newest version: `id`, `label`, `kind`, `version`, `author`,
        `time`, `note`.
        """
        return list(self._page("/programs", limit, after))

    def program(self, program: str, version: int | None = None) -> Json:
        """A stored program with its `text`. The default is the newest version."""
        params = {} if version is None else {"version": version}
        return self._json("GET", _program_path(program), params=params)

    def program_versions(
        self, program: str, limit: int | None = None, after: str | None = None
    ) -> list[Json]:
        """The stored versions of a program, newest first."""
        return list(self._page(f"{_program_path(program)}/versions", limit, after))

    def save_program(
        self,
        program: str,
        label: str,
        text: str | Mapping[str, Any],
        *,
        kind: str = "sequence",
        note: str = "",
        base: int | None = None,
    ) -> Json:
        """Save a version of a program.

        Args:
            program: id of the program: a-z, 0-9, _ and -.
            label: display name of the program, in any language.
            text: the sequence file, as text or as a dictionary; or the Lua program.
            kind: "sequence" or "lua".
            base: number of the version that this one is based on; None for a new program.

        Raises:
            ChangedError: another client has saved a version in the meantime; the message names it.
        """
        body = {"label": label, "kind": kind, "note": note}
        body["text"] = text if isinstance(text, str) else json.dumps(dict(text), ensure_ascii=False, indent=1)
        headers = {} if base is None else {"If-Match": f'"{base}"'}
        return self._json("PUT", _program_path(program), json=body, headers=headers)

    def restore_program(self, program: str, version: int) -> Json:
        """Save an old version again, as the newest one."""
        old, newest = self.program(program, version), self.program(program)
        return self.save_program(
            program,
            old["label"],
            old["text"],
            kind=old["kind"],
            note=f"version {version} again",
            base=newest["version"],
        )

    def delete_program(self, program: str) -> list[Json]:
        """Delete a stored program with all its versions. Returns the remaining programs."""
        return list(self._request("DELETE", _program_path(program)))

    def run_program(self, program: str, **options: Any) -> Json:
        """Run a stored program. `options` are the options of POST /programs/{program}/run. `sequence_status`
        reports its progress.
        """
        return self._json("POST", f"{_program_path(program)}/run", json=options)

    def start_study(self, document: Mapping[str, Any], max_s: float = 3600.0) -> Json:
        """Start a study in the service, or continue it. Returns the same answer as `study`, as soon as the
        study's tasks are known.

        Args:
            document: content of a study file. It must not refer to files or functions; `program` may be
                {"stored": ID}.
            max_s: maximum duration of this run.
        """
        body = {**document, "max_s": max_s}
        return self._json("POST", "/studies", json=body, timeout=self._motion_timeout_s)

    def studies(self, limit: int | None = None, after: str | None = None) -> list[Json]:
        """The studies in the service, newest first; see `study`."""
        return list(self._page("/studies", limit, after)["studies"])

    def study(self, study: str) -> Json:
        """A study: `state` (running, finished, partial, failed), `reason`, `done`, `tasks`, `left_s`,
        `answer` (partial while the study is running), and `job`. Cancelling this job ends the study.
        """
        return self._json("GET", f"/studies/{study}")

    def study_map(self, study: str) -> Json:
        """The map of a reach study: `x`, `y`, `z`, `values` by metric, `ranges`, `metrics`."""
        return self._json("GET", f"/studies/{study}/map")

    def fetch_study_table(self, study: str, file: Path | str) -> None:
        """Write all results of a study to a file. The format is SQLite, or Parquet if the service has
        duckdb.
        """
        self._fetch(f"/studies/{study}/table", Path(file))

    def delete_study(self, study: str) -> list[Json]:
        """Delete a study with its results. Returns the remaining studies."""
        return list(self._json("DELETE", f"/studies/{study}")["studies"])

    def call_service(self, robot: str, robot_class: str, method: str, arguments: Mapping[str, Any]) -> Json:
        """Call one of the robot's vendor services by name. Returns `code` (0 is success), `message` and
        `result`.
        """
        url = self._of_service(f"/{robot}/{robot_class}/{method}")
        return self._json("POST", url, json=dict(arguments), timeout=self._motion_timeout_s)

    def _of_service(self, path: str) -> str:
        """The URL of a path of the service. It is the same if this client is connected to one of several
        robots.
        """
        base = self._http.base_url
        return str(base.copy_with(path=f"{service_of(str(base))}{path}"))

    def who_controls(self) -> Json:
        """Return the client that has control, and the current motion of the robot: `held`, `holder`,
        `address`, `how`, `what`, `since`, `until`.
        """
        return self._json("GET", "/robot/control")

    @contextlib.contextmanager
    def control(self, *, timeout_s: float = 60.0, force: bool = False) -> Iterator[Json]:
        """Take control: within the `with` block only this client moves the robot. Yields the service's
        answer.

        Args:
            timeout_s: time without a motion after which control is lost. Each motion restarts this time.
            force: take control even if another client has it; the motion of that client ends.

        Raises:
            ConflictError: another client has control; the message names it. The error is raised inside the
                block if another client takes control.
        """
        body = {"timeout_s": timeout_s, "force": force}
        taken = self._json("POST", "/robot/control", json=body, timeout=15.0)
        self._http.headers[CONTROL_TOKEN] = str(taken["token"])
        try:
            yield taken
        finally:
            with contextlib.suppress(CobotError):  # control is already lost, or the service does not answer
                self._json("DELETE", "/robot/control")
            del self._http.headers[CONTROL_TOKEN]

    def stop(self, *, category: int = 2) -> Json:
        """End the sequence, the planning and the motion. The answer reports whether the arm is at rest.

        Without a robot name, all robots are stopped. The request is repeated if there is no answer or the
        service is busy, because an overloaded service closes connections before it reads their requests.

        Args:
            category: with 2, the arm stops on its path, and the drives hold it. With 1, it stops as fast as
                the limits permit, and the drives are then off until `reset`.
        """
        params = None if category == 2 else {"category": category}
        for _ in range(STOP_TRIES - 1):
            with contextlib.suppress(UnavailableError):
                return self._json("POST", "/stop", params=params, timeout=STOP_TIMEOUT_S)
        return self._json("POST", "/stop", params=params, timeout=STOP_TIMEOUT_S)

    def acknowledge(self, *, payload_checked: bool = False) -> Json:
        """Confirm that the findings of the first contact describe the real arm. Motions then run at full
        speed.

        Args:
            payload_checked: whether the arm carries the tool and the load of the model, so that no tool needs
                to be set.
        """
        body = {"payload_checked": payload_checked}
        return self._json("POST", "/robot/acknowledge", json=body)

    def reset(self) -> Json:
        """Clear an e-stop or a fault. Switching a robot on may take seconds."""
        return self._json("POST", "/robot/reset", timeout=self._motion_timeout_s)

    def health(self) -> Json:
        """Processes, cycle times, versions."""
        return self._json("GET", "/health")


def _program_path(program: str) -> str:
    return f"/programs/{quote(program, safe='')}"


def _compact(solid: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a solid. A numpy array of points is converted to `points_base64`."""
    fields = dict(solid)
    points: Any = fields.get("points")
    if hasattr(points, "astype"):
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points: an array of shape (n, 3) is needed, got {points.shape}")
        fields["points_base64"] = base64.b64encode(points.astype("<f4").tobytes()).decode("ascii")
        del fields["points"]
    return fields

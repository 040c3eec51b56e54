"""The process of `worker.Worker`: its tasks and its limits."""

from __future__ import annotations

import json
import os
import resource
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cobot.errors import ConfigError, InputError


def write_solids(file: str, into: str, name: str, scale: list[float], split: bool) -> dict[str, Any]:
    """Write a mesh as convex solids in metres; see `convex.solids`."""
    from cobot.launch.robot_file import convex, mesh_reading

    vertices, triangles = mesh_reading.read_mesh(Path(file))
    vertices = vertices * scale
    found = convex.solids(vertices, triangles, split)
    files = []
    for index, solid in enumerate(found.solids):
        files.append(f"{name}_{index}.stl" if len(found.solids) > 1 else f"{name}.stl")
        convex.write_stl(Path(into) / files[-1], solid)
    size = (vertices.max(axis=0) - vertices.min(axis=0)).tolist()
    return {"files": files, "size": size, "void": found.void_m, "wrong": found.is_wrong, "flat": found.flat}


def write_look(file: str, into: str, triangles: int) -> dict[str, Any]:
    """Write a mesh with its colours as GLB, in metres, and return the number of its triangles; see
    `mesh_reading.as_glb`.
    """
    from cobot.launch.robot_file import mesh_reading

    content, count = mesh_reading.as_glb(Path(file), triangles)
    Path(into).write_bytes(content)
    return {"triangles": count}


def compile_mjcf(file: str) -> dict[str, Any]:
    """Have MuJoCo read and compile a file, and allocate the memory that the model needs.

    Errors in the file are not reported here, because the parent process also finds them.

    Raises:
        MemoryError: the model needs too much memory.
        ConfigError: MuJoCo fails without a reason, usually because a size in the file is far too large.
    """
    import mujoco

    from cobot.launch.robot_file.mjcf import reason, remove_textures

    try:
        spec = mujoco.MjSpec.from_file(file)
        remove_textures(spec)
        mujoco.MjData(spec.compile())
    except ValueError as exc:
        if "allocate memory" in str(exc):
            raise MemoryError from exc
    except RuntimeError as exc:
        raise ConfigError(
            f"MuJoCo fails to load it without a clear reason: {reason(exc)[:200]} Usually a size in the "
            "file is far too large; simplify it"
        ) from exc
    return {}


DAMAGED = "cannot be read: it is damaged, empty or of another format; export it again, for example as STL"


def expand_xacro(file: str, into: str, arguments: dict[str, str], packages: list[str]) -> dict[str, Any]:
    """Write the URDF that a xacro file describes; see `xacro_file.expand`."""
    from cobot.launch.robot_file import xacro_file

    xacro_file.expand(Path(file), Path(into), arguments, [Path(package) for package in packages])
    return {}


TASKS: dict[str, Callable[..., dict[str, Any]]] = {
    "solids": write_solids,
    "look": write_look,
    "mjcf": compile_mjcf,
    "xacro": expand_xacro,
}


def main() -> None:
    """Answer requests until the parent is gone."""
    limit = int(sys.argv[1]) << 30
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries may print to the output
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer = TASKS[request.pop("task")](**request)
        except (ConfigError, InputError) as exc:
            answer = {"error": str(exc)}
        except MemoryError:
            answer = {"error": f"needs more than {sys.argv[1]} GB of memory; simplify it"}
        except Exception:  # noqa: BLE001  readers of meshes raise whatever they like
            answer = {"error": DAMAGED}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()

"""Studies in processes that are killed, on clusters, and as a newcomer starts them.

Oracles: the results of a run that nothing disturbs; Linux's list of processes; Dask's own scheduler and
workers; Chromium, which runs the script of the map.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
from certificates import certificate
from study_functions import function_study

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "studies"
COBOT = (sys.executable, "-P", "-m", "cobot", "study")
WAIT_S = 120.0
needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="Dask is not installed: it is in the extra study"
)
needs_chromium = pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")


def run(*words: object, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COBOT, *map(str, words)],
        cwd=folder,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


def wait_for(what: Callable[[], object]) -> None:
    end = time.monotonic() + WAIT_S
    while not what():
        assert time.monotonic() < end
        time.sleep(0.02)


def file_of(folder: Path, function: str) -> Path:
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(function_study(folder, function).document), encoding="utf-8")
    return path


def chunks(folder: Path) -> list[str]:
    return sorted(path.name for path in (folder / "chunks").glob("*.npz")) if folder.exists() else []


def children_of(pid: int) -> list[int]:
    """All processes that a process has started, by Linux."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        found += [int(word) for word in (task / "children").read_text().split()]
    return found


def results(folder: Path) -> dict[str, bytes]:
    names = ("answer.json", "manifest.json", "results.sqlite", "results.parquet")
    return {name: (folder / name).read_bytes() for name in names if (folder / name).exists()}


@pytest.mark.thorough
def test_killed_runs_and_workers_lose_and_repeat_nothing(tmp_path: Path) -> None:
    file = file_of(tmp_path, "slow")
    assert run(file, "--output", "whole", folder=tmp_path).returncode == 0
    out, finished = tmp_path / "out", set[str]()
    for number in range(3):
        _run_and_kill(file, out, with_worker=number == 0)
        assert finished <= set(chunks(out))  # what was finished stays, and is not computed again
        finished = set(chunks(out))
        shown = run("show", "out", "--json", folder=tmp_path)
        assert json.loads(shown.stdout)["answer"]["done"] > 0
    assert run(file, "--output", "out", folder=tmp_path).returncode == 0
    assert finished <= set(chunks(out))
    assert results(out) == results(tmp_path / "whole")


def _run_and_kill(file: Path, out: Path, with_worker: bool) -> None:
    """Run a study until it has one chunk more, kill a worker and the run, and wait for the end of all."""
    before = len(chunks(out))
    study = subprocess.Popen([*COBOT, str(file), "--output", out.name, "--workers", "2"], cwd=out.parent)
    try:
        wait_for(lambda: len(chunks(out)) > before or study.poll() is not None)
        workers = children_of(study.pid) if study.poll() is None else []
        if with_worker and workers:
            os.kill(workers[0], signal.SIGKILL)
            wait_for(lambda: len(chunks(out)) > before + 1 or study.poll() is not None)
            workers = children_of(study.pid) if study.poll() is None else []
    finally:
        study.kill()
        study.wait()
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))


def test_an_interrupted_run_answers_in_part_and_leaves_no_process(tmp_path: Path) -> None:
    file = file_of(tmp_path, "slow")
    study = subprocess.Popen(
        [*COBOT, str(file), "--output", "out", "--workers", "1"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        text=True,
    )
    wait_for(lambda: chunks(tmp_path / "out"))
    workers = children_of(study.pid)
    study.send_signal(signal.SIGINT)
    said, _ = study.communicate(timeout=WAIT_S)
    assert study.returncode in (0, 130)
    assert ("run the same command to continue" in said) == (study.returncode == 130)
    assert not any(Path(f"/proc/{pid}").exists() for pid in workers)


@pytest.mark.thorough
def test_the_example_of_a_function_answers(tmp_path: Path) -> None:
    done = run(EXAMPLES / "fall.yaml", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"survives at height_m 0.1 +1 \(256 of 256\), 95 % interval 0.98\d+ to 1", done.stdout)


@needs_chromium
def test_a_newcomer_sees_a_map(tmp_path: Path) -> None:
    """The example with larger steps, so that it is quick."""
    content = yaml.safe_load((EXAMPLES / "reach.yaml").read_text(encoding="utf-8"))
    content["space"]["spacing_m"] = 0.2
    (tmp_path / "reach.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    done = run("reach.yaml", "--output", "out", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    page = tmp_path / "out" / "map.html"
    chromium = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=3000"]
    shown = subprocess.run(
        [*chromium, "--dump-dom", f"file://{page}"],
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert "0.800 m" in shown.stdout  # the script has drawn the map and written the height of the cut
    answer = json.loads((tmp_path / "out" / "answer.json").read_text())
    assert 0 < answer["places reached"] < answer["places"]


@contextmanager
def cluster(
    folder: Path, workers: int, **environment: str
) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Dask's scheduler and workers, each a process of its own, on the loopback interface."""
    started: list[subprocess.Popen[bytes]] = []
    file = folder / "scheduler.json"
    environment = os.environ | {"DASK_TEMPORARY_DIRECTORY": str(folder)} | environment
    dask = [sys.executable, "-P", "-m", "distributed.cli"]
    try:
        scheduler = [f"{dask[-1]}.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        command = [*dask[:-1], *scheduler, "--scheduler-file", str(file)]
        started.append(subprocess.Popen(command, cwd=folder, env=environment))
        wait_for(lambda: file.exists() and file.read_text().endswith("}"))
        address = json.loads(file.read_text())["address"]
        worker = [f"{dask[-1]}.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        command = [*dask[:-1], *worker]
        started += [subprocess.Popen(command, cwd=folder, env=environment) for _ in range(workers)]
        yield f"dask://{address.partition('://')[2]}", started[1:]
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


@pytest.mark.thorough
@needs_dask
def test_dask_computes_the_same_although_a_worker_is_killed(tmp_path: Path) -> None:
    file = file_of(tmp_path, "slow")
    assert run(file, "--output", "whole", folder=tmp_path).returncode == 0
    with cluster(tmp_path, 2) as (address, workers):
        command = [*COBOT, str(file), "--output", "out", "--engine", address]
        wait_for(lambda: _has_workers(address, 2))
        study = subprocess.Popen(command, cwd=tmp_path)
        wait_for(lambda: chunks(tmp_path / "out"))
        workers[0].kill()
        assert study.wait(timeout=WAIT_S) == 0
    assert results(tmp_path / "out") == results(tmp_path / "whole")


def _has_workers(address: str, count: int) -> bool:
    from distributed import Client

    with Client(address.replace("dask://", "tcp://"), set_as_default=False) as client:
        return len(client.scheduler_info(n_workers=-1)["workers"]) >= count


@pytest.mark.thorough
@needs_dask
def test_with_certificates_dask_serves_only_peers_that_have_one(tmp_path: Path) -> None:
    """As docs/studies.md has it."""
    file, pem = file_of(tmp_path, "product"), certificate(tmp_path, "own")
    stranger = certificate(tmp_path, "other")
    with cluster(tmp_path, 1, **_encrypted(pem)) as (address, _):
        done = run(file, "--output", "out", "--engine", address, folder=tmp_path, **_encrypted(pem))
        assert done.returncode == 0, done.stderr
        for environment in ({}, _encrypted(stranger)):
            done = run(file, "--output", "no", "--engine", address, folder=tmp_path, **environment)
            assert done.returncode == 1
            assert "does not answer" in done.stderr
            assert "Traceback" not in done.stderr


def _encrypted(pem: Path) -> dict[str, str]:
    """Dask's variables for mutual TLS with one certificate, which is its own authority."""
    tls = {"CA_FILE": pem} | {
        f"{who}__{what}": pem if what == "CERT" else pem.with_suffix(".key")
        for who in ("SCHEDULER", "WORKER", "CLIENT")
        for what in ("CERT", "KEY")
    }
    found = {f"DASK_DISTRIBUTED__COMM__TLS__{name}": str(path) for name, path in tls.items()}
    return found | {"DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "True"}


@pytest.mark.thorough
@needs_dask
def test_a_worker_with_another_cobot_is_refused_by_name(tmp_path: Path) -> None:
    """A copy of cobot with one more comment is another cobot."""
    file = file_of(tmp_path, "product")
    for package in ("cobot", "rtloop"):
        shutil.copytree(ROOT / package, tmp_path / "other" / package, symlinks=False)
    for name in ("config", "sequences"):
        shutil.copytree(ROOT / name, tmp_path / "other" / name)
    with (tmp_path / "other" / "cobot" / "clock.py").open("a") as source:
        source.write("# changed\n")
    path = os.pathsep.join([str(tmp_path / "other"), os.environ.get("PYTHONPATH", "")])
    with cluster(tmp_path, 1, PYTHONPATH=path) as (address, _):
        wait_for(lambda: _has_workers(address, 1))
        done = run(file, "--output", "out", "--engine", address, folder=tmp_path)
    assert done.returncode == 1
    assert re.search(
        r"cobot: the worker on \S+ has a different source of cobot: [0-9a-f]{16}, but the study needs",
        done.stderr,
    )


@needs_dask
@pytest.mark.parametrize(
    ("engine", "message"),
    [
        ("dask://192.0.2.1:8786", "a host other than 127.0.0.1 needs mutual TLS"),
        ("dask://127.0.0.1:1", "the Dask scheduler at tcp://127.0.0.1:1 does not answer"),
    ],
)
def test_a_scheduler_that_cannot_be_trusted_or_reached_is_an_error(
    engine: str, message: str, tmp_path: Path
) -> None:
    done = run(file_of(tmp_path, "product"), "--engine", engine, folder=tmp_path)
    assert done.returncode == 1
    assert message in done.stderr
    assert "Traceback" not in done.stderr

"""The command line. Oracles: the function itself; the exit statuses of docs/cli.md."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest
import yaml
from folders import ROOT
from study_functions import function_study, reach_study

from cobot.studies import load_study
from cobot.studies.__main__ import main

EXAMPLES = ROOT / "examples" / "studies"


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "product.yaml"
    path.write_text(yaml.safe_dump(function_study(tmp_path).document), encoding="utf-8")
    return path


def test_a_study_answers_in_words_and_its_folder_again(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(file), "--workers", "1"]) == 0
    said = capsys.readouterr().out
    assert "How large is it?" in said
    assert "best value          12" in said
    assert "tasks/s per worker" in said
    (folder,) = (path for path in file.parent.iterdir() if path.is_dir() and path.name.startswith("product-"))
    assert main(["show", str(folder)]) == 0
    assert "best value          12" in capsys.readouterr().out


def test_the_answer_is_one_document_of_json(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(file), "--workers", "1", "--output", "out", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["answer"]["best value"] == 12.0
    assert all(Path(name).is_file() for name in answer["files"])
    assert main(["show", "out", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["answer"] == answer["answer"]


def test_a_map_is_drawn(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file.write_text(yaml.safe_dump(reach_study().document), encoding="utf-8")
    assert main([str(file), "--workers", "1", "--output", "out"]) == 0
    (Path("out") / "map.png").unlink()
    assert main(["show", "out"]) == 0
    assert (Path("out") / "map.png").read_bytes().startswith(b"\x89PNG")


def test_the_answer_of_a_folder_that_cannot_be_written_is_shown(
    file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file.write_text(yaml.safe_dump(reach_study().document), encoding="utf-8")
    assert main([str(file), "--workers", "1", "--output", "out"]) == 0
    said = capsys.readouterr().out

    def refuse(*_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(os, "replace", refuse)
    assert main(["show", "out"]) == 0
    found = capsys.readouterr()
    assert found.out.strip() in said
    assert found.err.startswith("cobot: the maps are not drawn: ")


@pytest.mark.parametrize("name", sorted(path.name for path in EXAMPLES.glob("*.yaml")))
def test_each_example_can_begin(name: str) -> None:
    study = load_study(EXAMPLES / name)
    turn = next(study.rounds()) if "search" not in study.document else None
    assert turn is None or turn.last == study.tasks > 1
    kernel = study.kernel()
    if turn is not None:
        assert len(next(iter(kernel(0, 1).values()))) == 1


def test_bad_input_is_one_line_on_standard_error(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file.write_text("question: x\nkind: reech\n", encoding="utf-8")
    assert main([str(file)]) == 1
    said = capsys.readouterr().err
    assert said.startswith(
        f"cobot: {file}: kind: unknown kind 'reech' (did you mean 'reach'?); valid kinds: "
    )
    assert said.count("\n") == 1
    assert main(["none.yaml"]) == 1
    assert capsys.readouterr().err == "cobot: none.yaml: no such file\n"
    assert main(["show", "none"]) == 1
    assert "none/manifest.json: there is no such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--workers", "0"], "'0' is not an integer from 1 to 1024"),
        (["--nice", "20"], "'20' is not an integer from 0 to 19"),
    ],
)
def test_wrong_usage_is_explained(
    words: list[str], message: str, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        main([str(file), *words])
    assert exit_.value.code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("engine", "message"),
    [
        ("ray://a:1", "must be local or dask://HOST:PORT"),
        ("dask://a", "must be local or dask://HOST:PORT"),
        ("dask://a:99999", "must be local or dask://HOST:PORT"),
    ],
)
def test_an_unknown_engine_is_rejected(
    engine: str, message: str, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(file), "--engine", engine]) == 1
    assert message in capsys.readouterr().err

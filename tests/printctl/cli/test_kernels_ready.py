"""Kernel compilation before a command, with a message."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from kernels import ahead as listing
from printctl.cli import kernels_ready
from printctl.cli.kernels_ready import have_kernels
from printctl.cli.main import app
from printctl.progress_file import ProgressFile
from printctl.web.design.runs import read_progress


@pytest.fixture(autouse=True)
def _empty_store(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    everything = listing.needed_kernels
    monkeypatch.setattr(listing, "needed_kernels", lambda *works: everything(*works)[:2])


def test_few_are_left_to_their_first_call(capsys, tmp_path) -> None:
    have_kernels("simulate")
    assert capsys.readouterr().err == ""
    assert not list(tmp_path.rglob("*.nbc"))


def test_many_are_compiled_and_told_once(monkeypatch, capsys, tmp_path) -> None:
    monkeypatch.setattr(kernels_ready, "MIN_KERNELS", 1)
    told = ProgressFile(tmp_path / "progress.jsonl")
    have_kernels("simulate", listener=told)
    said = capsys.readouterr().err
    assert "2 to compile, once for this version" in said
    assert f"2 ready, kept in {tmp_path}" in said.replace("\n", "")
    (stage,) = read_progress("one", told.path).stages
    assert (stage.name, stage.state, stage.fraction) == ("kernels", "done", 1.0)
    have_kernels("simulate")
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_doctor_compiles_the_list(tmp_path) -> None:
    done = CliRunner().invoke(app, ["doctor", "--warm"])
    assert "2 ready" in done.output
    assert len(list(tmp_path.rglob("*.nbc"))) >= 2

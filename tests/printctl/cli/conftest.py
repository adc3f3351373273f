"""Fixture of commands run in an empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.printctl.cli.shell import Shell


@pytest.fixture
def shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    monkeypatch.chdir(tmp_path)
    return Shell(monkeypatch, capsys)

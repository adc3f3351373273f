"""Helper: run a command in this process, in a temporary folder."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import pytest

from printctl.cli.main import main


class Shell:
    """Runs commands: exit code, stdout and stderr of each.

    ``first`` are words that every command begins with.
    """

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *first: str
    ) -> None:
        self.monkeypatch, self.capsys, self.first = monkeypatch, capsys, first

    def __call__(self, *command: str) -> tuple[int, str, str]:
        self.monkeypatch.setattr("sys.argv", ["printctl", *self.first, *command])
        self.capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = self.capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, out, err

    def of(self, *first: str) -> Shell:
        """Another one, whose commands begin with these words."""
        return Shell(self.monkeypatch, self.capsys, *first)

    def json(self, *command: str) -> Any:
        """What a command that ends well prints with --json."""
        code, out, err = self(*command, "--json")
        assert code == 0, err
        return json.loads(out)

    def refuses(self, said: str | Iterable[str], *command: str, code: int = 2) -> None:
        """Assert that a command ends with a code and one message that has these words."""
        ended, out, err = self(*command)
        assert (ended, out) == (code, ""), err
        assert err.count("printctl:") <= 1
        for words in (said,) if isinstance(said, str) else said:
            assert words in " ".join(err.split())

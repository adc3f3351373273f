"""Helper: run a command in this process, in a temporary folder."""

from __future__ import annotations

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

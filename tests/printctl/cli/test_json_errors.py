"""One JSON object on stdout for a failure of any kind, beside the text on stderr."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from printctl.cli import commands
from tests.printctl.cli.shell import Shell


@pytest.fixture
def shell(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Shell:
    monkeypatch.chdir(tmp_path)
    return Shell(monkeypatch, capsys)


@pytest.mark.parametrize(
    ("words", "code", "why"),
    [
        (["simulate", "--json"], 2, "file"),
        (["run", "a.yaml", "--jsno", "--json"], 2, "jsno"),
        (["nope", "--json"], 2, "nope"),
        (["simulate", "nix.gcode", "--json"], 2, "nix.gcode can't be read"),
        (["simulate", "a", "--ink", "x", "--ink", "y", "--json"], 2, "twice"),
        (["station", "status", "--folder", "nix", "--json"], 1, "no printer was ever connected"),
        (
            ["print", "a.gcode", "--printer", "generic_marlin", "--port", "/dev/null", "--json"],
            3,
            "--yes",
        ),
    ],
)
def test_a_failure_is_one_object_with_code_and_message(
    shell: Shell, words: list[str], code: int, why: str
) -> None:
    Path("a.gcode").write_text("G21\nG90\nG1 X1 F600\n")
    ended, out, err = shell(*words)
    error = json.loads(out)["error"]
    assert (ended, error["code"]) == (code, code)
    assert why in error["message"]
    assert err


def test_a_refused_simulation_is_one_object_with_its_checks_and_the_error(shell: Shell) -> None:
    Path("a.gcode").write_text("G21\nG90\nG1 X1000 F600\n")
    ended, out, _ = shell("simulate", "a.gcode", "--json")
    told = json.loads(out)
    assert ended == told["error"]["code"] == 3
    assert "x, highest" in told["error"]["message"]
    assert not told["passed"]


@pytest.mark.parametrize(("raised", "code"), [(KeyboardInterrupt, 130), (ZeroDivisionError, None)])
def test_ctrl_c_and_faults_of_our_own_are_told_too(
    shell: Shell,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    raised: type[BaseException],
    code: int | None,
) -> None:
    def fails(*words: object) -> None:
        raise raised

    monkeypatch.setattr(commands, "import_module", fails)
    if code is None:
        with pytest.raises(ZeroDivisionError):
            shell("doctor", "--json")
        assert json.loads(capsys.readouterr().out)["error"]["code"] == 1
    else:
        ended, out, _ = shell("doctor", "--json")
        assert ended == json.loads(out)["error"]["code"] == code

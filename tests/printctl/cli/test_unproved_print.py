"""Print disturbed by another program's commands: not reported as proven complete."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from printctl.cli import print_job
from printctl.cli.main import app
from printctl.machine.link import LinkState, PrintOutcome

JOB = "M85 S600\nM302 P1\nG90\nM82\nG1 X1 Y5 E0.1 F600\nG1 X2 Y5 E0.2 F600\n"


@pytest.mark.parametrize(("known", "code"), [(True, 0), (False, 1)])
def test_exit_code_tells_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, known: bool, code: int
) -> None:
    ended = PrintOutcome(LinkState.DONE, 6, 6, "all 6 lines done", position_known=known)
    monkeypatch.setattr(print_job, "_print", lambda *given: ended)
    file = tmp_path / "job.gcode"
    file.write_text(JOB)
    words = ["print", str(file), "--printer", "generic_marlin", "--port", "simulated", "--json"]
    found = CliRunner().invoke(app, words, catch_exceptions=False)
    assert found.exit_code == code, found.output
    told = json.loads(found.stdout)
    assert (told["state"], told["proved"]) == ("done", known)


@pytest.mark.parametrize("state", [LinkState.FAILED, LinkState.STOPPED])
def test_only_a_print_that_is_done_is_proved(state: LinkState) -> None:
    assert not PrintOutcome(state, 6, 6, "").proved

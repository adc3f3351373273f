"""`printctl observe answer`: taken while the print waits for it, refused otherwise."""

import pytest

from printctl.cli.machine.running_print import answer, looks, status
from printctl.errors import UsageError
from printctl.observe.records import look_folder, read_answer
from printctl.web.workspace import Workspace
from tests.printctl.web.job.looks.held import JOB, print_held_for_a_look


def test_an_answer_is_taken_once_and_none_when_the_print_went_on(tmp_path, capsys):
    workspace = Workspace(tmp_path).make()
    with print_held_for_a_look(workspace) as client:
        folder = workspace.print_folder(JOB)
        for word in ("yes", "APPROVE", ""):
            with pytest.raises(UsageError, match="is no answer"):
                answer(folder, word)
        looks(folder)
        said = capsys.readouterr().out
        assert "look 1 asks to" in said
        assert "approve --look 1`" in said
        status(folder)
        assert "look 1 asks to" in capsys.readouterr().out
        with pytest.raises(UsageError, match="look 2 isn't the last, which is look 1"):
            answer(folder, "approve", 2)
        assert read_answer(folder, 1) is None
        answer(folder, "go_on", 1)
        looks(folder)
        said = capsys.readouterr().out
        assert "answered: go_on" in said
        assert "asks to" not in said
        status(folder)
        assert "asks to" not in capsys.readouterr().out
        with pytest.raises(UsageError, match="answered before: go_on"):
            answer(folder, "approve")
        (look_folder(folder, 1) / "answer.json").unlink()
        client.stop()
        client.wait(300)
        with pytest.raises(UsageError, match="isn't waiting for an answer to look 1"):
            answer(folder, "approve")
        assert read_answer(folder, 1) is None
        looks(folder)
        assert "asks to" not in capsys.readouterr().out


def test_of_a_look_whose_observer_is_gone_it_is_said_how_to_have_another(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("printctl.cli.machine.running_print.alive", lambda *_: False)
    workspace = Workspace(tmp_path).make()
    with print_held_for_a_look(workspace):
        looks(workspace.print_folder(JOB))
    said = capsys.readouterr().out
    assert "its observer is gone: `printctl resume RUN` starts another one" in said
    assert "approve --look" not in said

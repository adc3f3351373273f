"""Compiling ahead leaves nothing behind."""

from __future__ import annotations

import os

import pytest

from printctl import warm
from printctl.link.history import PrintHistory, data_folder, remember_meanwhile
from printctl.link.journal import Journal
from printctl.link.record import JOURNAL
from printctl.warm import history_in, warm_growth, warm_prints


def test_prints_made_to_compile_are_not_among_the_users(tmp_path, monkeypatch):
    """A print's own process is begun with this environment, and remembers the print by it."""
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "mine"))
    remembered: list[int] = []

    def printed(recipe, base, folder, console):
        folder.mkdir(exist_ok=True)
        journal = Journal(folder / JOURNAL)
        journal.add("job", name=recipe.name, sha256="0", lines=1)
        journal.close()
        remember_meanwhile(folder).join(10)
        remembered.append(len(PrintHistory().entries()))
        assert os.environ["PRINTCTL_DATA"] == str(data_folder()) != str(tmp_path / "mine")

    for name in ("run_recipe", "design_recipe"):
        monkeypatch.setattr(warm, name, printed)
    monkeypatch.setattr(warm, "draw", lambda folder: None)
    warm_growth()
    warm_prints()
    assert len(remembered) == 4
    assert all(remembered)
    assert data_folder() == tmp_path / "mine"
    assert PrintHistory().entries() == []


@pytest.mark.parametrize("before", [None, "there"])
def test_history_is_where_it_was_afterwards_even_if_it_fails(monkeypatch, tmp_path, before):
    if before is None:
        monkeypatch.delenv("PRINTCTL_DATA")
    else:
        monkeypatch.setenv("PRINTCTL_DATA", before)
    with pytest.raises(KeyError), history_in(tmp_path):
        assert data_folder() == tmp_path
        raise KeyError
    assert os.environ.get("PRINTCTL_DATA") == before

"""`printctl profiles show`: copies a shipped profile to a file of one's own."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from firmware_profiles import Ink, Printer, load
from printctl.cli.main import app
from printctl.errors import UsageError


def test_a_shipped_profile_is_copied_to_a_new_file_of_ones_own(tmp_path: Path) -> None:
    for model, name in ((Printer, "generic_marlin"), (Ink, "collagen_fresh")):
        out = tmp_path / f"{name}.yaml"
        words = ["profiles", name, "--write", str(out)]
        assert CliRunner().invoke(app, words).exit_code == 0
        assert load(model, str(out)) == load(model, name)
        with pytest.raises(UsageError, match="there already"):
            CliRunner().invoke(app, words, catch_exceptions=False)


def test_only_a_shipped_profile_is_copied_and_to_yaml_alone(tmp_path: Path) -> None:
    for words in (["--write", "mine.yaml"], ["generic_marlin", "--write", "mine.txt"]):
        with pytest.raises(UsageError):
            CliRunner().invoke(app, ["profiles", *words], catch_exceptions=False)

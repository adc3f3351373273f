"""Dependency audit: fails on vulnerabilities, reports when it couldn't ask."""

import importlib.util
import sys
from pathlib import Path

import pytest

PLACE = Path(__file__).parents[1] / ".ci" / "audit.py"


@pytest.fixture
def audit(monkeypatch):
    spec = importlib.util.spec_from_file_location("audit", PLACE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "audit", module)
    spec.loader.exec_module(module)
    return module


SAFE = {"name": "numpy", "version": "2.4.6", "vulns": []}
BAD = {
    "name": "pillow",
    "version": "1.0",
    "vulns": [{"id": "CVE-2020-1", "fix_versions": ["1.1"], "description": "x"}],
}
UNKNOWN = {"name": "ours", "skip_reason": "Dependency not found on PyPI"}


def answers(audit, monkeypatch, *dependencies):
    monkeypatch.setattr(audit, "ask", lambda service: audit.read({"dependencies": dependencies}))


def test_a_known_vulnerability_fails_with_name_and_remedy(audit, monkeypatch, capsys):
    answers(audit, monkeypatch, SAFE, BAD, UNKNOWN)
    assert audit.main() == 1
    out = capsys.readouterr().out
    assert "pillow 1.0: CVE-2020-1 (mended in 1.1)" in out
    assert "2 pins asked of pypi, 1 unknown to it: 1 vulnerable" in out


def test_nothing_known_passes(audit, monkeypatch, capsys):
    answers(audit, monkeypatch, SAFE)
    assert audit.main() == 0
    assert "0 vulnerable" in capsys.readouterr().out


def test_a_service_that_knows_no_pin_was_not_asked(audit, monkeypatch, capsys):
    answers(audit, monkeypatch, UNKNOWN)
    assert audit.main() == 0
    assert "NOT DONE" in capsys.readouterr().out


def test_no_answer_passes_and_is_said(audit, monkeypatch, capsys):
    monkeypatch.setattr(audit, "ask", lambda service: None)
    assert audit.main() == 0
    assert "NOT DONE" in capsys.readouterr().out

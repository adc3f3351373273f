"""Entry of the benchmarks: parts that are there, are skipped, or fail."""

import json
import sys
from importlib import import_module
from types import SimpleNamespace

import pytest

from benchmarks.__main__ import SUBJECTS, measure
from benchmarks.common import SkippedError, row

PLACES = sorted(place for parts in SUBJECTS.values() for place in parts.values())


@pytest.mark.parametrize("place", PLACES)
def test_each_part_names_a_function(place):
    module, _, function = place.partition(":")
    assert callable(getattr(import_module(f"benchmarks.{module}"), function))


def good(quick):
    yield row("speed", 2.0 if quick else 3.0, "mm/s")


def skipped(quick):
    raise SkippedError("needs a camera")


def failing(quick):
    yield row("half", 1.0)
    raise ValueError("broke")


@pytest.fixture
def parts(monkeypatch):
    made = SimpleNamespace(good=good, skipped=skipped, failing=failing)
    monkeypatch.setitem(sys.modules, "benchmarks.made", made)
    return {name: f"made:{name}" for name in ("failing", "skipped", "good")}


def test_a_failing_part_is_named_and_the_others_run(parts, capsys):
    assert measure(parts, None, quick=True) == 1
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [one["measure"] for one in rows] == ["half", "failing", "skipped", "speed"]
    assert rows[1]["error"] == "ValueError: broke"
    assert rows[2]["skipped"] == "needs a camera"
    assert rows[3]["value"] == 2.0


def test_a_skipped_part_is_no_failure(parts, capsys):
    assert measure(parts, "skipped", quick=False) == 0
    assert len(json.loads(capsys.readouterr().out)["rows"]) == 1

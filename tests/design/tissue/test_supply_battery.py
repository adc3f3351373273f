"""A handful of the battery's tissues (`make bench-tissue` has three hundred)."""

from __future__ import annotations

import io
import json
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from benchmarks.checkers import write_stl
from benchmarks.tissue import worker
from benchmarks.tissue.cases import make, true_volume
from benchmarks.tissue.run import corners_of, judged, welded_volumes
from tests.slower import first_of

KINDS = ("point", "inverted", "shells", "sheets", "edge", "face", "flat", "joints", "voxels")


@pytest.mark.parametrize("kind", first_of(KINDS, 2))
def test_every_part_is_supplied(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, path = make(kind, 0), tmp_path / f"{kind}-0.stl"
    write_stl(path, corners_of(case.mesh))
    # Here, not in a process of its own as the benchmark does: that imports all of it once more.
    monkeypatch.setattr(sys, "argv", ["worker", str(path)])
    with redirect_stdout(io.StringIO()) as told:
        worker.main()
    lines = map(json.loads, told.getvalue().splitlines())
    said = {one["done"]: one for one in lines if "done" in one}
    found = judged(case, said[path.stem], path)
    assert found["result"] == "supplied", found


@pytest.mark.parametrize("kind", ["apart", "many", "sizes", "linked"])
def test_the_judges_parts_are_those_of_the_file(kind: str) -> None:
    case = make(kind, 1)
    true = sorted((true_volume(part) for part in case.parts), reverse=True)
    assert welded_volumes(case.mesh) == pytest.approx(true, rel=1e-4)

"""A handful of the battery's tissues (`make bench-tissue` has three hundred)."""

from __future__ import annotations

import io
import json
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from benchmarks.supply_bench import worker
from benchmarks.supply_bench.cases import make, true_volume
from benchmarks.supply_bench.judge import welded_volumes
from benchmarks.supply_bench.run import judged, write_stl

KINDS = ("point", "shells", "sheets", "inverted")


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, object]]:
    folder = tmp_path_factory.mktemp("battery")
    cases = {f"{kind}-0": make(kind, 0) for kind in KINDS}
    paths = [folder / f"{name}.stl" for name in cases]
    for path in paths:
        write_stl(path, cases[path.stem].mesh)
    # Here, not in a process of its own as the benchmark does: that imports all of it once more.
    with redirect_stdout(io.StringIO()) as told, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["worker", *map(str, paths)])
        worker.main()
    lines = map(json.loads, told.getvalue().splitlines())
    said = {one["done"]: one for one in lines if "done" in one}
    return {p.stem: judged(cases[p.stem], said[p.stem], Path(p)) for p in paths}


@pytest.mark.parametrize("kind", KINDS)
def test_every_part_is_supplied(results: dict[str, dict[str, object]], kind: str) -> None:
    assert results[f"{kind}-0"]["result"] == "supplied", results[f"{kind}-0"]


@pytest.mark.parametrize("kind", ["apart", "many", "sizes", "linked"])
def test_the_judges_parts_are_those_of_the_file(kind: str) -> None:
    case = make(kind, 1)
    true = sorted((true_volume(part) for part in case.parts), reverse=True)
    assert welded_volumes(case.mesh) == pytest.approx(true, rel=1e-4)

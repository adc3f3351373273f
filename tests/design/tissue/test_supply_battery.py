"""A handful of the battery's tissues (`make bench-tissue` has three hundred)."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.supply_bench.cases import make, true_volume
from benchmarks.supply_bench.judge import welded_volumes
from benchmarks.supply_bench.run import grown, judged, write_stl

KINDS = ("point", "edge", "face", "shells", "flat", "sheets", "joints", "inverted", "voxels")


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, object]]:
    folder = tmp_path_factory.mktemp("battery")
    cases = {f"{kind}-0": make(kind, 0) for kind in KINDS}
    paths = [folder / f"{name}.stl" for name in cases]
    for path in paths:
        write_stl(path, cases[path.stem].mesh)
    said = {one["done"]: one for one in grown(paths)}
    return {p.stem: judged(cases[p.stem], said[p.stem], Path(p)) for p in paths}


@pytest.mark.parametrize("kind", KINDS)
def test_every_part_is_supplied(results: dict[str, dict[str, object]], kind: str) -> None:
    assert results[f"{kind}-0"]["result"] == "supplied", results[f"{kind}-0"]


@pytest.mark.parametrize("kind", ["apart", "many", "sizes", "linked"])
def test_the_judges_parts_are_those_of_the_file(kind: str) -> None:
    case = make(kind, 1)
    true = sorted((true_volume(part) for part in case.parts), reverse=True)
    assert welded_volumes(case.mesh) == pytest.approx(true, rel=1e-4)

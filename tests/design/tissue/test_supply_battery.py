"""A handful of the battery's tissues (`make bench-tissue` has three hundred)."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.supply_bench.cases import make
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

from pathlib import Path

import numpy as np
import pytest

from design.errors import NetworkError
from design.network import VesselNetwork
from design.units import LengthUnit
from printctl.analysis.networks import check_target, read_noted, write_network
from printctl.errors import UsageError
from tests.design.networks import random_network, random_trees

UNITS: dict[str, LengthUnit | None] = {
    ".csv": "mm", ".vtp": "mm", ".swc": None, ".json": None, ".npz": None,
}  # fmt: skip


def same(found: VesselNetwork, network: VesselNetwork, rel: float) -> None:
    """Vessels and their shapes; some formats renumber nodes, and order vessels their own way."""

    def shapes(each: VesselNetwork) -> list[tuple[float, ...]]:
        rows = zip(each.lengths(), each.mean_radius(), each.kind, strict=True)
        return sorted(tuple(np.round([float(v) for v in row], 9)) for row in rows)

    assert found.vessel_count == network.vessel_count
    np.testing.assert_allclose(shapes(found), shapes(network), rtol=rel)


@pytest.mark.parametrize("first", UNITS)
@pytest.mark.parametrize("second", UNITS)
def test_every_format_becomes_every_other(tmp_path: Path, first: str, second: str) -> None:
    network = random_trees(3, 9, 2)
    a, b = tmp_path / f"a{first}", tmp_path / f"b{second}"
    write_network(a, network)
    write_network(b, read_noted(a, UNITS[first]).network)
    same(read_noted(b, UNITS[second]).network, network, 1e-9)


def test_simvascular_paths_are_a_new_folder(tmp_path: Path) -> None:
    write_network(tmp_path / "Paths", random_trees(3, 9, 2))
    assert list((tmp_path / "Paths").glob("*.pth"))
    with pytest.raises(UsageError, match="new folder"):
        write_network(tmp_path / "Paths", random_trees(3, 9, 2))
    assert {path.name for path in tmp_path.iterdir()} == {"Paths"}


def test_a_format_that_cannot_hold_a_network_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match="trees only"):
        write_network(tmp_path / "loops.swc", random_network(1, 12))
    assert list(tmp_path.iterdir()) == []


def test_a_failed_folder_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(folder: Path, network: VesselNetwork) -> None:
        (folder / "path_0001.pth").write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("printctl.analysis.networks.write_simvascular_paths", full)
    with pytest.raises(OSError, match="No space"):
        write_network(tmp_path / "Paths", random_trees(3, 9, 2))
    assert list(tmp_path.iterdir()) == []


def test_the_unit_is_asked_for_where_the_format_is_silent(tmp_path: Path) -> None:
    network = random_trees(3, 4, 1)
    for suffix, unit in UNITS.items():
        path = tmp_path / f"a{suffix}"
        write_network(path, network)
        if unit is not None:
            with pytest.raises(UsageError, match="--unit"):
                read_noted(path, None)
        elif suffix != ".swc":
            with pytest.raises(UsageError, match="drop --unit"):
                read_noted(path, "cm")


@pytest.mark.parametrize(
    ("name", "word"),
    [("a.xyz", "isn't a network's"), ("a", "no suffix"), ("a.csv", "isn't there")],
)
def test_wrong_sources_are_refused(tmp_path: Path, name: str, word: str) -> None:
    with pytest.raises(UsageError, match=word):
        read_noted(tmp_path / name, "mm")


def test_wrong_targets_are_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(UsageError, match="is a folder"):
        check_target(tmp_path / "folder.csv")
    with pytest.raises(UsageError, match=r"\.obj can't be written"):
        check_target(tmp_path / "a.obj")

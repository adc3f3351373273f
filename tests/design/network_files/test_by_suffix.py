"""Network files: format chosen by suffix, units never guessed."""

from pathlib import Path

import numpy as np
import pytest

from design import planar_four_vessel, read_network, write_network
from design.errors import NetworkError


@pytest.mark.parametrize("suffix", [".csv", ".json", ".npz"])
def test_network_reads_back_as_it_was_written(tmp_path: Path, suffix: str):
    path, network = tmp_path / f"network{suffix}", planar_four_vessel()
    write_network(path, network)
    again = read_network(path, "mm")
    np.testing.assert_array_equal(again.vessel_nodes, network.vessel_nodes)
    np.testing.assert_allclose(again.points, network.points)
    np.testing.assert_allclose(again.radius, network.radius)


@pytest.mark.parametrize(
    ("name", "unit", "message"),
    [
        ("a.csv", None, "doesn't say the unit.*give unit"),
        ("a.swc", "mm", "is in um.*leave unit out"),
        ("a.docx", None, r"\.docx can't be read.*\.csv"),
        ("a", None, "no suffix can't be read"),
    ],
)
def test_what_cannot_be_read_is_refused(name, unit, message):
    with pytest.raises(NetworkError, match=message):
        read_network(Path(name), unit)


def test_a_format_that_cannot_be_written_is_refused(tmp_path: Path):
    with pytest.raises(NetworkError, match=r"\.txt can't be written"):
        write_network(tmp_path / "a.txt", planar_four_vessel())

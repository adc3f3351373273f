"""`network.vtp`, decoded here by the rules of VTK's XML format."""

from __future__ import annotations

import base64
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from design.errors import NetworkError
from design.network import VesselNetwork
from design.network_files.vtp import write_network_vtp

DTYPES = {"Float64": "<f8", "Float32": "<f4", "Int64": "<i8", "Int32": "<i4"}


def _network() -> VesselNetwork:
    return VesselNetwork(
        nodes=np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0.1]]),
        vessel_nodes=np.array([[0, 1], [1, 2]]),
        kind=np.array([0, 1]),
        tree=np.array([5, 6]),
        offset=np.array([0, 3, 5]),
        points=np.array([[0.0, 0, 0], [1, 1, 0], [3, 0, 0], [3, 0, 0], [3, 4, 0.1]]),
        radius=np.array([0.5, 0.4, 0.3, 0.3, 0.1]),
    )


def _arrays(path: Path) -> dict[str, np.ndarray]:
    root = ET.parse(path).getroot()
    assert root.attrib["type"] == "PolyData"
    assert root.attrib["header_type"] == "UInt64"
    arrays = {}
    for element in root.iter("DataArray"):
        data = base64.b64decode(element.text or "")
        (size,) = np.frombuffer(data[:8], "<u8")
        assert size == len(data) - 8
        values = np.frombuffer(data[8:], DTYPES[element.attrib["type"]])
        width = int(element.attrib["NumberOfComponents"])
        arrays[element.attrib["Name"]] = values.reshape(-1, width) if width > 1 else values
    return arrays


def test_points_radii_and_cells_are_those_of_the_network(tmp_path: Path) -> None:
    network = _network()
    path = tmp_path / "network.vtp"
    write_network_vtp(path, network, {"flow_ul_s": np.array([1.5, -2.0])})
    arrays = _arrays(path)
    assert np.array_equal(arrays["Points"], network.points)
    assert np.array_equal(arrays["radius_mm"], network.radius)
    assert arrays["connectivity"].tolist() == [0, 1, 2, 3, 4]
    assert arrays["offsets"].tolist() == [3, 5]
    assert arrays["kind"].tolist() == [0, 1]
    assert arrays["tree"].tolist() == [5, 6]
    assert arrays["vessel"].tolist() == [0, 1]
    assert arrays["flow_ul_s"].tolist() == [1.5, -2.0]


def test_an_array_of_another_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match="flow: 3 values for 2 vessels"):
        write_network_vtp(tmp_path / "n.vtp", _network(), {"flow": np.zeros(3)})


def test_text_is_refused_before_a_file_is_left(tmp_path: Path) -> None:
    with pytest.raises(NetworkError, match="name: type"):
        write_network_vtp(tmp_path / "n.vtp", _network(), {"name": np.array(["a", "b"])})
    assert list(tmp_path.iterdir()) == []

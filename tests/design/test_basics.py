"""Conversion to display units and back."""

import errno
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import design
import registration
from design.display import LAB, Units
from design.errors import DesignError, NetworkError
from design.files import atomic_replacement, write_text
from design.network import VesselNetwork
from design.on_demand import exported_names
from tests.design.networks import network


@pytest.mark.parametrize(
    ("quantity", "unit", "ours", "shown"),
    [
        ("length", "µm", 0.4, 400),
        ("length", "um", 0.4, 400),
        ("length", "cm", 25, 2.5),
        ("pressure", "kPa", 13332.2, 13.3322),
        ("pressure", "mmHg", 13332.2, 100),
        ("pressure", "mbar", 100, 1),
        ("flow", "mL/min", 1000, 60),
        ("flow", "uL/min", 2, 120),
        ("shear", "dyn/cm2", 1.5, 15),
    ],
)
def test_a_value_is_shown_in_the_unit_asked_for(quantity, unit, ours, shown):
    units = Units(**{quantity: unit})
    assert units.of(quantity, ours) == pytest.approx(shown)


@given(
    value=st.floats(-1e6, 1e6),
    quantity=st.sampled_from(["length", "pressure", "flow", "shear"]),
    units=st.sampled_from([LAB, Units(), Units("cm", "kPa", "uL/min", "dyn/cm²")]),
)
def test_what_is_shown_is_taken_back(value, quantity, units):
    assert units.back(quantity, units.of(quantity, value)) == pytest.approx(value)


def test_a_unit_that_is_not_known_is_refused_with_those_that_are():
    with pytest.raises(DesignError, match=r"pressure can't be shown in 'psi'.*mmHg"):
        Units(pressure="psi")


# Atomic file writing: a failed write leaves the old file.


def test_success_replaces_the_old_file_and_a_full_disk_leaves_it(tmp_path: Path) -> None:
    path = tmp_path / "sub" / "a.txt"
    write_text(path, "old")
    write_text(path, "new")
    assert path.read_text() == "new"
    assert [entry.name for entry in path.parent.iterdir()] == ["a.txt"]
    with pytest.raises(OSError, match=r"full: .*a\.txt"), atomic_replacement(path) as draft:
        draft.write_text("half")
        raise OSError(errno.ENOSPC, "disk full")
    assert path.read_text() == "new"
    assert [entry.name for entry in path.parent.iterdir()] == ["a.txt"]


# Public names of the packages `design` and `registration`.

QUICK = "import design.files, registration, sys; print('trimesh' in sys.modules)"


@pytest.mark.parametrize("package", [design, registration])
def test_a_package_hands_on_what_it_names(package):
    assert sorted(exported_names(package.__name__)) == sorted(package.__all__)


def test_a_room_is_not_loaded_before_it_is_asked_for():
    done = subprocess.run([sys.executable, "-c", QUICK], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


# Network class: derived quantities, and refusal of invalid input.

NODES = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0], [6, 0, 0]])
ENDS = np.array([[0, 1], [1, 2], [1, 3]])


def forked(radius: object = (1.0, 0.5, 0.5), nodes: object = NODES) -> VesselNetwork:
    return network(nodes, ENDS, radius)


def test_lengths_ends_and_moves_are_those_of_the_polylines() -> None:
    made = forked()
    np.testing.assert_allclose(made.lengths(), [3, 4, 3])
    np.testing.assert_allclose(made.mean_radius(), [1, 0.5, 0.5])
    assert made.inlets().tolist() == [0]
    assert made.outlets().tolist() == [2, 3]
    assert made.degree().tolist() == [1, 3, 1, 1]
    moved = forked().moved(np.array([1.0, 2, 3]))
    np.testing.assert_allclose(moved.nodes, NODES + [1, 2, 3])
    np.testing.assert_allclose(moved.lengths(), forked().lengths())


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 0.0, -1.0])
def test_impossible_position_or_radius_is_refused_with_its_vessel(bad: float) -> None:
    with pytest.raises(NetworkError, match="vessel 1: radius"):
        forked(radius=(1.0, bad, 0.5))
    if not np.isfinite(bad):
        with pytest.raises(NetworkError, match="vessel 2: position"):
            forked(nodes=[*NODES[:3], [6.0, bad, 0.0]])

"""Datums by recipe and command: a scan of lumens alone, laid on its axes and mouths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from registration import RegistrationReport, Scan, register_scan, report_dict
from registration.errors import DatumError
from registration.measuring.geometry import read_datums
from registration.report.measurement_tables import frame_lines, zone_table
from tests.registration.parts import bent_network, lumens, solid
from tests.registration.registered import FAST, bent_lumens

NETWORK = bent_network()


Registered = tuple[Scan, RegistrationReport]


@pytest.fixture(scope="module")
def registered(tmp_path_factory: pytest.TempPathFactory) -> Registered:
    return bent_lumens(tmp_path_factory)


@pytest.mark.slow
def test_the_chosen_datums_lay_the_rigid_fit_and_not_the_scaled_one(
    registered: Registered,
) -> None:
    scan, plain = registered
    datums = read_datums(["axis 0", "outlet 4"])
    chosen = register_scan(scan, solid(lumens(NETWORK)), NETWORK, replace(FAST, datums=datums))
    assert plain.frame.names == ()
    assert chosen.frame.names == ("axis 0", "outlet 4")
    assert chosen.scaled_scan_to_part == pytest.approx(plain.scaled_scan_to_part)
    assert np.abs(chosen.transform_scan_to_part - plain.transform_scan_to_part).max() > 1e-4
    # The datum's own vessel lies where it is designed, though the print has shrunk by 2 %.
    by_name = {(one.name, one.feature): one for one in chosen.characteristics}
    assert by_name["axis", "vessel 0"].zone_um < 40
    assert by_name["port", "outlet 4"].zone_um < 15
    assert by_name["cylindricity", "vessel 0"].zone_um < 40
    numbers = report_dict(chosen)
    assert frame_lines(numbers)[0].startswith("Datums: axis 0 (primary), outlet 4 (secondary)")
    table = zone_table(numbers)
    assert table is not None
    assert len(table.rows) == len(chosen.characteristics)


@pytest.mark.slow
def test_lumens_scanned_alone_have_no_outer_face_to_be_a_datum(registered: Registered) -> None:
    options = replace(FAST, datums=read_datums(["face -z"]))
    with pytest.raises(DatumError, match=r"no planar outer face .* \(it has: none\)"):
        register_scan(registered[0], solid(lumens(NETWORK)), NETWORK, options)

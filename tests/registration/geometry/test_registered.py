"""Datums by recipe and command: a scan of lumens alone, laid on its axes and mouths."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from registration import RegistrationOptions, Scan, register_scan, report_dict
from registration.alignment import AlignmentOptions
from registration.errors import DatumError
from registration.geometry import read_datums
from registration.report.zones import frame_lines, zone_table
from tests.registration.parts import as_scan, lumens, solid
from tests.registration.test_register import bent_network, microct_of

FAST = RegistrationOptions(
    alignment=AlignmentOptions(coarse_points=700, fine_points=6000, contest_points=20_000)
)
NETWORK = bent_network()


@cache
def scan() -> Scan:
    return as_scan(microct_of(NETWORK, NETWORK, seed=3))


def test_the_chosen_datums_lay_the_rigid_fit_and_not_the_scaled_one() -> None:
    plain = register_scan(scan(), solid(lumens(NETWORK)), NETWORK, FAST)
    datums = read_datums(["axis 0", "outlet 4"])
    chosen = register_scan(scan(), solid(lumens(NETWORK)), NETWORK, replace(FAST, datums=datums))
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


def test_lumens_scanned_alone_have_no_outer_face_to_be_a_datum() -> None:
    options = replace(FAST, datums=read_datums(["face -z"]))
    with pytest.raises(DatumError, match=r"no planar outer face .* \(it has: none\)"):
        register_scan(scan(), solid(lumens(NETWORK)), NETWORK, options)

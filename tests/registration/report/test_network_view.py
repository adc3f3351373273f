import numpy as np
import pytest

from registration.report.network_view import network_view, per_vessel, point_pressure
from registration.report.sections import vessel_summary
from registration.report.tables import MAX_ROWS, Column, make_table, vessel_index

from .sample import planar_network, sample_data


def test_colourings_hold_a_value_for_each_vessel() -> None:
    network, data = planar_network(), sample_data()
    data["registration"]["vessels"].pop(3)
    made = {c["name"]: c for c in network_view(network, data)["colourings"]}
    assert made["Designed diameter"]["values"][5] == pytest.approx(0.4)
    error = made["Diameter error"]["values"]
    assert len(error) == 14
    assert error[3] is None
    assert error[5] == data["registration"]["vessels"][4]["error_percent"]
    assert {"Flow", "Wall shear", "Inlet pressure"} <= set(made)


def test_records_of_unknown_vessels_are_left_out() -> None:
    rows = [{"vessel": 99, "x": 1.0}, {"vessel": -1, "x": 1.0}, {"vessel": "1", "x": 2.0},
            {"vessel": "inlet", "x": 3.0}, {"vessel": True, "x": 4.0}]  # fmt: skip
    values = per_vessel(rows, "x", 3)
    assert values[1] == 2.0
    assert np.isnan(values[[0, 2]]).all()


def test_pressure_falls_evenly_between_the_ends() -> None:
    network = planar_network()
    flow = [{"vessel": 5, "pressure_in_mmhg": 8.0, "pressure_out_mmhg": 6.0}]
    pressure = point_pressure(network, flow)
    assert pressure is not None
    assert pressure[10:12].tolist() == [8.0, 6.0]
    assert np.isnan(np.delete(pressure, [10, 11])).all()
    assert point_pressure(network, []) is None


def test_vessel_numbers_are_told_from_names() -> None:
    assert vessel_index({"vessel": 4}) == 4
    assert vessel_index({"vessel": "4"}) == 4
    assert vessel_index({"vessel": "left"}) is None
    assert vessel_index({"vessel": "²"}) is None
    assert vessel_index({}) is None


def test_columns_that_nobody_fills_are_left_out() -> None:
    columns = [Column("a", "A"), Column("b", "B"), Column("c", "C", kind="mark")]
    table = make_table("t", [{"a": 1.234}, {"a": -20.0, "c": False}], columns)
    assert [c.key for c in table.columns] == ["a", "c"]
    assert [cell.text for cell in table.rows[1].cells] == ["\u221220.0", "no"]
    assert [cell.mark for cell in table.rows[0].cells] == ["", ""]
    assert table.rows[1].cells[1].mark == "bad"
    assert table.rows[0].cells[0].order == "1.234"


def test_bars_share_one_track() -> None:
    rows = [{"d": 400.0, "m": 380.0}, {"d": 800.0, "m": None}, {"d": 600.0, "m": 800.0}]
    table = make_table("t", rows, [Column("d", "D")], ("d", "m"))
    assert [row.bar for row in table.rows] == [(50.0, 47.5), None, (75.0, 100.0)]


def test_rows_are_capped() -> None:
    table = make_table("t", [{"a": i} for i in range(MAX_ROWS + 5)], [Column("a", "A")])
    assert (len(table.rows), table.total) == (MAX_ROWS, MAX_ROWS + 5)


def test_summary_of_vessels() -> None:
    rows = [{"open": True, "error_percent": -4.0, "narrowest_um": 350.0},
            {"open": False, "error_percent": 2.0, "narrowest_um": None}]  # fmt: skip
    lines = {f.label: f.value for f in vessel_summary({"vessels": rows})}
    assert lines["Open"] == "1 of 2"
    assert lines["Mean diameter error"] == "\u22121"
    assert lines["Mean size of the error"] == "3"
    assert lines["Narrowest lumen"] == "350"

"""Dye arrivals, patency and verdicts, on videos of known flow."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from design.vasculature.named import planar_four_vessel
from registration.dye import (
    DyeOptions,
    DyeReport,
    Marks,
    dye_verdict,
    measure_dye,
    read_marks,
)
from registration.dye.flow import carrying_flow, solve_without_closed
from registration.dye.patency import _Seen, _stop
from registration.dye.stations import place_stations
from registration.dye.view import find_view
from registration.errors import DyeError
from tests.registration.dye.films import (
    PLANAR_CAMERA,
    PLANAR_FLOW,
    PLANAR_MARKS,
    TUBE_CAMERA,
    filmed,
    marks_of,
    planar_report,
    tube,
)
from tests.registration.dye.simulated_film import Disturbance, Dye, DyeFilm, Occlusion, dye_flow

TUBE_FLOW = np.pi * 0.25**2 * 4.0
"""4 mm/s on the mean."""
STEADY = Disturbance(noise=1.0, texture=0.02)


def _states(report: DyeReport) -> dict[int, str]:
    return {v.vessel: v.patency for v in report.vessels if v.patency != "open"}


@pytest.fixture(scope="module")
def steady(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a tube's film and its marks."""
    folder = tmp_path_factory.mktemp("steady")
    film = DyeFilm(20.0, 8.0, 1.0, TUBE_CAMERA, Dye(), STEADY)
    assert filmed(folder, tube(), TUBE_FLOW, (0, 1), film) == folder / "film.avi"
    return folder


def _tube_report(folder: Path, options: DyeOptions) -> DyeReport:
    return measure_dye(folder / "film.avi", read_marks(folder / "marks.yaml"), tube(), options)


def test_dye_in_a_tube_arrives_when_taylor_says(steady: Path) -> None:
    options = DyeOptions(flow_ul_s=TUBE_FLOW, start_s=1.0)
    report = _tube_report(steady, options)
    # Mean over the section c = 1 - s/(2Ut): half of the level c(t_end) at the film's end.
    way = report.stations.points[:, 0]
    end = 0.95 * 7.95 - 1.0
    half = 0.5 * (1.0 - way / (2.0 * 4.0 * end))
    arrival = 1.0 + way / (2.0 * 4.0) / (1.0 - half)
    late = report.arrivals.time_s - arrival
    assert report.arrivals.dyed.mean() > 0.9
    assert abs(np.nanmedian(late)) < 0.03
    assert np.nanpercentile(np.abs(late), 95) < 0.08
    assert report.vessels[0].patency == "open"
    assert dye_verdict(report, 40.0)["outcome"] == "pass"


def test_flow_and_start_are_found_from_the_film(report: DyeReport) -> None:
    assert report.prediction.flow_ul_s == pytest.approx(TUBE_FLOW, rel=0.03)
    assert report.prediction.start_s == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_a_network_agrees_with_the_independent_simulator(tmp_path: Path) -> None:
    report = planar_report(tmp_path)
    late = np.abs(report.late_s())
    assert _states(report) == {}
    assert report.prediction.flow_ul_s == pytest.approx(PLANAR_FLOW, rel=0.03)
    assert np.nanmedian(late) < 0.08
    assert np.nanpercentile(late, 90) < 0.4


@pytest.mark.parametrize("seep", [0.0, 0.3])
@pytest.mark.slow
def test_an_occluded_branch_is_found_in_its_vessel(tmp_path: Path, seep: float) -> None:
    report = planar_report(tmp_path, [Occlusion(7, 0.6, seep_ul_s=seep)])
    assert _states(report) == {7: "blocked"}
    assert dye_verdict(report, 40.0)["outcome"] == "fail"
    found = report.vessels[7]
    if seep:
        # It lies 6 mm along; stations are a third of a millimetre apart.
        assert found.blocked_from_mm == pytest.approx(6.0, abs=0.5)
        assert found.blocked_to_mm == pytest.approx(6.0, abs=0.5)
    else:
        assert found.blocked_from_mm is None


def test_shake_and_drift_alone_are_no_arrival(tmp_path: Path) -> None:
    spoilt = Disturbance(drift=0.3, shake_px=1.5)
    faint = Dye(absorbance_per_mm=(1e-6, 1e-6, 1e-6))
    with pytest.raises(ValueError, match=r"no dye|fewer than"):
        planar_report(tmp_path, spoilt=spoilt, dye=faint, seconds=8.0)


def test_vessels_under_others_are_not_seen() -> None:
    network, camera = planar_four_vessel(), dataclasses.replace(PLANAR_CAMERA, side="y")
    marks = Marks.model_validate(marks_of(network, camera, PLANAR_MARKS))
    stations = place_stations(network, find_view(marks, network), (144, 256))
    # From the front all channels lie behind one another.
    assert not stations.seen[np.isin(stations.vessel, (5, 6, 7, 8))].any()
    assert stations.seen[stations.vessel == 0].any()


def test_a_film_too_short_leaves_vessels_unseen_not_blocked(tmp_path: Path) -> None:
    report = planar_report(tmp_path, seconds=5.0)
    assert "blocked" not in _states(report).values()
    assert dye_verdict(report, 40.0)["outcome"] == "undecided"


@pytest.mark.slow
def test_a_closure_that_dye_has_just_come_to_is_not_called_open(tmp_path: Path) -> None:
    report = planar_report(tmp_path, [Occlusion(5, 0.5, seep_ul_s=0.25)])
    assert report.vessels[5].patency in ("blocked", "not seen")


# Nothing is claimed that the video doesn't show.


@pytest.fixture(scope="module")
def report(steady: Path) -> DyeReport:
    return _tube_report(steady, DyeOptions())


def test_a_pass_says_what_was_allowed_and_a_vessel_that_cant_be_timed_is_none(
    report: DyeReport,
) -> None:
    assert dye_verdict(report, 40.0)["outcome"] == "pass"
    untimed = [dataclasses.replace(v, leaves_s=None) for v in report.vessels]
    found = dye_verdict(dataclasses.replace(report, vessels=untimed), 40.0)
    assert found["outcome"] == "undecided"
    assert "too little is seen to time dye in vessel 0" in found["reasons"][0]
    found = dye_verdict(report, 35.0)
    assert found["tolerance_percent"] == 35.0
    assert "within 35 %" in found["reasons"][0]
    assert "fitted" in found["reasons"][0]


def test_a_start_after_the_dye_no_numbers_and_marks_turned_round_are_refused(steady: Path) -> None:
    marks, film = read_marks(steady / "marks.yaml"), steady / "film.avi"
    with pytest.raises(DyeError, match=r"100 s.*film's clock"):
        measure_dye(film, marks, tube(), DyeOptions(start_s=100.0))
    with pytest.raises(DyeError, match="finite"):
        DyeOptions(flow_ul_s=float("nan"))
    pixels = [mark.pixel for mark in marks.marks][::-1]
    swapped = zip(marks.marks, pixels, strict=True)
    both = tuple(mark.model_copy(update={"pixel": pixel}) for mark, pixel in swapped)
    turned = marks.model_copy(update={"marks": both})
    with pytest.raises(DyeError, match="turned round"):
        measure_dye(film, turned, tube())


def seen(dyed: list[bool]) -> _Seen:
    share = (np.arange(len(dyed)) + 0.5) / len(dyed)
    return _Seen(share, np.array(dyed), 1.0, float(np.mean(dyed)))


def test_a_closure_is_where_dye_stops_whatever_blurs_in_at_the_far_end() -> None:
    network = tube()
    flow = carrying_flow(network, None)
    length = float(network.points[-1, 0] - network.points[0, 0])
    low, high = _stop(network, flow, 0, seen([True] * 10 + [False] * 19 + [True])) or (0, 0)
    assert low == pytest.approx(9.5 / 30 * length)
    assert high == pytest.approx(10.5 / 30 * length)
    assert _stop(network, flow, 0, seen([False] * 29 + [True])) is None


# Flow beside closed vessels.


NETWORK = planar_four_vessel()


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> DyeReport:
    """The widest channel, which carries most of the flow, is closed; the pump goes on."""
    options = DyeOptions(flow_ul_s=PLANAR_FLOW, start_s=1.5)
    return planar_report(tmp_path_factory.mktemp("closed"), [Occlusion(8, 0.3)], options=options)


def test_flow_beside_a_closed_vessel_is_the_simulators() -> None:
    flow = solve_without_closed(NETWORK, None, (7,))
    assert flow is not None
    # The simulator cuts vessel 7 in two pieces, both at rest.
    known = np.delete(dye_flow(NETWORK, 1.0, [Occlusion(7)]).flow_ul_s, 8)
    assert np.abs(flow.solution.flow) == pytest.approx(known, abs=1e-9)
    assert not flow.moves()[7]
    assert flow.moves().sum() == 13


def test_a_vessel_that_is_late_beside_a_closed_one_is_still_told(closed: DyeReport) -> None:
    def slow(vessel: int) -> DyeReport:
        vessels = list(closed.vessels)
        times = vessels[vessel].beside
        assert times is not None
        assert times.leaves_s is not None
        late = dataclasses.replace(times, leaves_s=times.leaves_s + 15.0)
        vessels[vessel] = dataclasses.replace(vessels[vessel], beside=late)
        return dataclasses.replace(closed, vessels=vessels)

    reasons = dye_verdict(slow(5), 40.0)["reasons"]
    assert any("dye leaves 10 of 11 others" in reason for reason in reasons)
    assert any("vessel 5: dye leaves 15 s too late" in reason for reason in reasons)

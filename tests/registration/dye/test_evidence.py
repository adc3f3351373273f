"""Dye verdict: nothing claimed that the video doesn't show."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.network import VesselNetwork
from registration.dye import DyeOptions, DyeReport, Marks, dye_verdict, measure_dye, read_marks
from registration.dye.arrivals import find_arrivals
from registration.dye.flow import carrying_flow
from registration.dye.patency import _Seen, _series, _stop
from registration.dye.traces import Traces
from registration.dye.view import find_view
from registration.errors import DyeError
from sim.devices.dye import Disturbance, Dye, DyeFilm
from tests.registration.dye.films import TUBE_CAMERA, filmed, tube

TUBE_FLOW = np.pi * 0.25**2 * 4.0


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tube")
    seen = DyeFilm(20.0, 8.0, 1.0, TUBE_CAMERA, Dye(), Disturbance(noise=1.0, texture=0.02))
    return filmed(folder, tube(), TUBE_FLOW, (0, 1), seen)


@pytest.fixture(scope="module")
def report(film: Path) -> DyeReport:
    return measure_dye(film, read_marks(film.parent / "marks.yaml"), tube())


def test_an_open_vessel_that_cant_be_timed_is_no_pass(report: DyeReport) -> None:
    assert dye_verdict(report, 40.0)["outcome"] == "pass"
    untimed = [dataclasses.replace(v, leaves_s=None) for v in report.vessels]
    found = dye_verdict(dataclasses.replace(report, vessels=untimed), 40.0)
    assert found["outcome"] == "undecided"
    assert "too little is seen to time dye in vessel 0" in found["reasons"][0]


def test_a_pass_says_what_was_fitted_and_what_was_allowed(report: DyeReport) -> None:
    found = dye_verdict(report, 35.0)
    assert found["tolerance_percent"] == 35.0
    assert "within 35 %" in found["reasons"][0]
    assert "fitted" in found["reasons"][0]


def test_a_start_after_the_dye_and_what_is_no_number_are_refused(film: Path) -> None:
    marks = read_marks(film.parent / "marks.yaml")
    with pytest.raises(DyeError, match=r"100 s.*film's clock"):
        measure_dye(film, marks, tube(), DyeOptions(start_s=100.0))
    with pytest.raises(DyeError, match="finite"):
        DyeOptions(flow_ul_s=float("nan"))


def test_marks_turned_round_are_told(film: Path) -> None:
    marks = read_marks(film.parent / "marks.yaml")
    pixels = [mark.pixel for mark in marks.marks][::-1]
    turned = marks.model_copy(
        update={
            "marks": tuple(
                mark.model_copy(update={"pixel": pixel})
                for mark, pixel in zip(marks.marks, pixels, strict=True)
            )
        }
    )
    with pytest.raises(DyeError, match="turned round"):
        measure_dye(film, turned, tube())


def test_a_step_of_compression_in_a_still_film_is_no_dye(report: DyeReport) -> None:
    step = np.where(report.traces.times > 3.0, 0.002, 0.0)
    still: Traces = dataclasses.replace(
        report.traces, dye=np.tile(step, (len(report.stations.radius), 1))
    )
    assert not find_arrivals(still, report.stations.radius).dyed.any()


def test_marks_in_line_would_fit_a_mirror_and_say_so() -> None:
    def marks(third: tuple[float, float, float], pixel: tuple[float, float]) -> Marks:
        places: list[Any] = [((0, 0, 0), (10.0, 50.0)), ((10, 0, 0), (110.0, 50.0))]
        places.append((third, pixel))
        return Marks.model_validate({"marks": [{"at_mm": p, "pixel": q} for p, q in places]})

    assert find_view(marks((5, 0, 0), (60.0, 50.0)), tube()).either_way
    assert not find_view(marks((5, 3, 0), (60.0, 20.0)), tube()).either_way


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


def test_dye_up_to_a_third_is_not_dye_at_the_far_end() -> None:
    shares = np.linspace(0.02, 0.3, 9)
    assert _Seen(shares, np.ones(9, bool), 0.3, 1.0).leaves is None
    shares = np.linspace(0.02, 0.98, 9)
    assert _Seen(shares, np.ones(9, bool), 0.98, 1.0).leaves is True


def test_a_vessel_that_flows_into_the_same_outlet_isnt_behind_a_closed_one() -> None:
    corners = np.array([[0, 0, 0], [4, 3, 0], [4, -3, 0], [8, 0, 0]], dtype=float)
    sides = np.array([[0, 1], [0, 2], [1, 3], [2, 3]])
    none = np.zeros(4, dtype=int)
    network = VesselNetwork.from_segments(corners, sides, np.full(4, 0.3), none, none)
    flow = carrying_flow(network, None)
    states: Any = {0: "open", 1: "blocked", 2: "blocked", 3: "not reached"}
    assert _series(network, flow, states, 2) == ()
    assert _series(network, flow, states, 1) == (3,)

"""Dye verdict: nothing claimed that the video doesn't show."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from registration.dye import DyeOptions, DyeReport, dye_verdict, measure_dye, read_marks
from registration.dye.flow import carrying_flow
from registration.dye.patency import _Seen, _stop
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

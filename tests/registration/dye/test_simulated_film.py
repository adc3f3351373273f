"""Simulated dye video: flow, transport and picture, against known results."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from design.hemodynamics import FlowConditions, solve_flow
from design.network import VesselKind
from design.vasculature.named import planar_four_vessel
from gcode.errors import SimError
from tests.design.networks import network
from tests.registration.dye.simulated_film import (
    Disturbance,
    DyeCamera,
    DyeFilm,
    Occlusion,
    Transport,
    dye_flow,
    film_frames,
    write_film,
)

INFLOW = 4.0
TUBE = network([[0, 0, 0], [10, 0, 0]], [[0, 1]], 0.25, VesselKind.CHANNEL)


def test_dye_in_a_tube_follows_taylor() -> None:
    # 5 mm/s on the mean: 2 s for 10 mm. Mean over the section: 1 - s/(2Ut).
    flow, times = dye_flow(TUBE, np.pi * 0.25**2 * 5.0), np.arange(120) / 15.0
    transport = Transport(flow, 1.0 / 15.0)
    seen = np.array([dye.mean(axis=1) for dye in transport.frames(times, 0.0)])
    count = seen.shape[1]
    for share in (0.25, 0.5, 1.0):
        cell = int(share * count) - 1
        way = 2.0 * (cell + 0.5) / count
        exact = np.maximum(0.0, 1.0 - way / (2.0 * np.maximum(times, 1e-9)))
        assert np.abs(seen[:, cell] - exact).max() < 0.08
        assert np.interp(0.5, seen[:, cell], times) == pytest.approx(way, rel=0.04)


def test_an_occlusion_stops_its_branch_and_keeps_the_inflow() -> None:
    flow = dye_flow(planar_four_vessel(), INFLOW, [Occlusion(6, 0.5)])
    rates = flow.flow_ul_s
    # Vessel 6 is two pieces now; the inlet carries all, as does the outlet.
    assert rates[6] == rates[7] == 0.0
    assert rates[0] == pytest.approx(INFLOW)
    assert rates[-1] == pytest.approx(INFLOW)
    assert rates[[5, 8, 9]].sum() == pytest.approx(INFLOW)


def test_a_film_darkens_by_beer_and_lambert() -> None:
    camera = DyeCamera(width=120, height=60, px_per_mm=20.0, centre_mm=(5.0, 0.0, 0.0))
    calm = Disturbance(noise=0.0, blur_px=0.0, texture=0.0)
    film = DyeFilm(fps=4.0, seconds=40.0, start_s=0.5, camera=camera, spoilt=calm)
    frames = list(film_frames(dye_flow(TUBE, 4.0), film, np.random.default_rng(0)))
    before, after = (frames[k][29:31, 60, 2].astype(float).mean() for k in (0, -1))
    # Half a millimetre of red absorbed at 1.2/mm.
    assert -np.log(after / before) == pytest.approx(0.6, rel=0.05)


def test_a_written_film_reads_back_with_its_clock(tmp_path: Path) -> None:
    camera = DyeCamera(width=120, height=64, px_per_mm=10.0)
    film = DyeFilm(fps=15.0, seconds=2.0, camera=camera)
    flow = dye_flow(TUBE, 4.0)
    write_film(tmp_path / "film.avi", flow, film, np.random.default_rng(0))
    reader, times = cv2.VideoCapture(str(tmp_path / "film.avi")), []
    while reader.read()[0]:
        times.append(reader.get(cv2.CAP_PROP_POS_MSEC) / 1000.0)
    assert np.diff(times) == pytest.approx(np.full(29, 1.0 / 15.0), abs=1e-3)
    with pytest.raises(SimError, match="written as"):
        write_film(tmp_path / "film.gif", flow, film, np.random.default_rng(0))


def test_flow_agrees_with_the_designs_solver() -> None:
    network = planar_four_vessel()
    solved = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=INFLOW))
    assert dye_flow(network, INFLOW).flow_ul_s == pytest.approx(np.abs(solved.flow), rel=1e-9)

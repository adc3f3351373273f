"""Small simulated dye videos with their marks."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from design.network import VesselNetwork
from design.vasculature.named import planar_four_vessel
from registration.dye import DyeOptions, DyeReport, measure_dye, read_marks
from tests.design.networks import polyline
from tests.registration.dye.simulated_film import (
    Disturbance,
    Dye,
    DyeCamera,
    DyeFilm,
    Occlusion,
    dye_flow,
    write_film,
)

PLANAR_FLOW = 0.25 * 1000.0 / 60.0
PLANAR_CAMERA = DyeCamera(width=256, height=144, px_per_mm=14.5)
PLANAR_MARKS = (0, 3, 4, 11)


def tube() -> VesselNetwork:
    """A straight tube, 10 mm long and 0.5 mm wide."""
    return polyline([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]], 0.25)


TUBE_CAMERA = DyeCamera(width=240, height=90, px_per_mm=20.0, centre_mm=(5.0, 0.0, 0.0))


def marks_of(
    network: VesselNetwork, camera: DyeCamera, nodes: Sequence[int], **more: Any
) -> dict[str, Any]:
    """What a careful user would write."""
    pixels = camera.pixels(network.nodes[list(nodes)]).tolist()
    marks = [{"node": n, "pixel": p} for n, p in zip(nodes, pixels, strict=True)]
    return {"marks": marks, "side": camera.side, "mirrored": camera.mirrored, **more}


def filmed(
    folder: Path,
    network: VesselNetwork,
    flow_ul_s: float,
    nodes: Sequence[int],
    film: DyeFilm,
    occlusions: Sequence[Occlusion] = (),
    seed: int = 1,
    mixing: float = 1.0,
) -> Path:
    """Write film.avi and marks.yaml; return the film's path."""
    flow = dye_flow(network, flow_ul_s, occlusions, mixing=mixing)
    write_film(folder / "film.avi", flow, film, np.random.default_rng(seed))
    marks = marks_of(network, film.camera, nodes)
    (folder / "marks.yaml").write_text(yaml.safe_dump(marks))
    return folder / "film.avi"


def planar_report(
    folder: Path,
    occlusions: Sequence[Occlusion] = (),
    spoilt: Disturbance | None = None,
    dye: Dye | None = None,
    seconds: float = 20.0,
    fps: float = 6.0,
    options: DyeOptions | None = None,
) -> DyeReport:
    """Film `planar_four_vessel` and measure."""
    film = DyeFilm(fps, seconds, 1.5, PLANAR_CAMERA, dye or Dye(), spoilt or Disturbance())
    network = planar_four_vessel()
    path = filmed(folder, network, PLANAR_FLOW, PLANAR_MARKS, film, occlusions)
    return measure_dye(path, read_marks(folder / "marks.yaml"), network, options)

"""Camera shake correction of dye videos: accuracy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.registration import phase_cross_correlation

from benchmarks.image_timing import against, cpu_ms
from design.vasculature.named import planar_four_vessel
from registration.dye.traces import Steadier, ground_pixels
from registration.dye.view import Marks, View, find_view
from sim.devices.dye import Disturbance, DyeCamera, DyeFilm, dye_flow
from sim.devices.dye.film import _shake, film_frames

FloatArray = NDArray[np.float64]
FLOW_UL_S = 0.25 * 1000.0 / 60.0
CAMERA = DyeCamera()


def film_rows(quick: bool) -> Iterator[dict[str, Any]]:
    """Rows of all films."""
    for texture in (0.03, 0.005):
        yield shake(12 if quick else 40, texture)


def seen_by(camera: DyeCamera) -> tuple[Any, View]:
    """Return the network and the view by exact marks."""
    network = planar_four_vessel()
    nodes = (0, 3, 4, 11)
    pixels = camera.pixels(network.nodes[list(nodes)]).tolist()
    marks = Marks.model_validate(
        {"marks": [{"node": n, "pixel": p} for n, p in zip(nodes, pixels, strict=True)]}
    )
    return network, find_view(marks, network)


def shake(count: int, texture: float) -> dict[str, Any]:
    """Frames with dye, drift of 20 %, shake of 2 px: RMS error of the shift, px."""
    spoilt = Disturbance(drift=0.2, shake_px=2.0, texture=texture)
    film = DyeFilm(6.0, count / 6.0, 1.5, CAMERA, spoilt=spoilt)
    network, view = seen_by(CAMERA)
    frames = list(film_frames(dye_flow(network, FLOW_UL_S), film, np.random.default_rng(1)))
    true = true_shake(film)
    first = np.maximum(frames[0].astype(np.float32), 1.0)
    off = ground_pixels(network, view, first.shape[:2])
    steadier = Steadier(first, off)
    rim = np.zeros_like(off)
    rim[12:-12, 12:-12] = off[12:-12, 12:-12]
    logs = [
        np.log(cv2.cvtColor(np.maximum(f.astype(np.float32), 1), cv2.COLOR_BGR2GRAY))
        for f in frames
    ]

    def ours() -> FloatArray:
        return np.array([steadier.shift(np.maximum(f.astype(np.float32), 1.0)) for f in frames])

    def by_ecc() -> FloatArray:
        found, warp = [], np.eye(2, 3, dtype=np.float32)
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
        for one in logs:
            try:
                _, warp = cv2.findTransformECC(
                    logs[0], one, warp, cv2.MOTION_TRANSLATION, stop, rim.astype(np.uint8), 5
                )
            except cv2.error:
                warp = np.eye(2, 3, dtype=np.float32)
            found.append(warp[:, 2].astype(float))
        return np.array(found)

    def by_phase() -> FloatArray:
        flat = [one - cv2.GaussianBlur(one, (0, 0), 8) for one in logs]
        found = [
            phase_cross_correlation(flat[0], one, reference_mask=rim, moving_mask=rim)[0]
            for one in flat
        ]
        return -np.array(found)[:, ::-1]

    ways: dict[str, Any] = {"ours": ours, "cv2.findTransformECC": by_ecc}
    if count <= 12:
        ways["skimage.phase_cross_correlation (masked)"] = by_phase
    found = {
        name: (float(np.sqrt(np.mean((way() - true) ** 2))), cpu_ms(way, 1) / count)
        for name, way in ways.items()
    }
    return against(f"camera shake, grain {texture:g}; per frame", "px", found.pop("ours"), **found)


def true_shake(film: DyeFilm) -> FloatArray:
    """Return the shake that `film_frames` draws, with the same draws before it."""
    generator = np.random.default_rng(1)
    for _ in range(2):
        generator.standard_normal((film.camera.height, film.camera.width))
    generator.uniform(0, 2 * np.pi)
    return np.asarray(_shake(film, film.times(), generator))

"""Films of dye: camera shake, the mask off the vessels, the simulated camera's moves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.registration import phase_cross_correlation

from benchmarks.image_timing import against, cpu_ms
from design.vasculature.named import planar_four_vessel
from registration.dye.marks import Marks
from registration.dye.still import Steadier, off_vessels
from registration.dye.view import View, find_view
from sim.dye import Disturbance, DyeCamera, DyeFilm, dye_flow
from sim.dye.film import _moved, _shake, film_frames

FloatArray = NDArray[np.float64]
FLOW_UL_S = 0.25 * 1000.0 / 60.0
CAMERA = DyeCamera()


def film_rows(quick: bool) -> Iterator[dict[str, Any]]:
    """Rows of all films."""
    for texture in (0.03, 0.005):
        yield shake(12 if quick else 40, texture)
    yield mask()
    yield moved()


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
    off = off_vessels(network, view, first.shape[:2])
    steadier = Steadier(cv2, first, off)
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


def mask() -> dict[str, Any]:
    """Pixels off the vessels, of 640 by 360: share that differs from ours."""
    network, view = seen_by(CAMERA)
    shape = (CAMERA.height, CAMERA.width)

    def painted() -> NDArray[np.bool_]:
        start, end, r0, r1, _ = network.pieces()
        off = np.ones(shape, np.uint8)
        for a, b, ra, rb in zip(
            view.pixels(start), view.pixels(end),
            r0 * view.scales(start) + 5, r1 * view.scales(end) + 5, strict=True,
        ):  # fmt: skip
            way = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
            side = np.array([-way[1], way[0]])
            quad = np.array([a + ra * side, b + rb * side, b - rb * side, a - ra * side])
            cv2.fillConvexPoly(off, np.round(quad * 256).astype(np.int32), 0, shift=8)
            for at, radius in ((a, ra), (b, rb)):
                cv2.circle(
                    off,
                    np.round(at * 256).astype(int).tolist(),
                    round(radius * 256),
                    0,
                    -1,
                    shift=8,
                )
        return off > 0

    def ours() -> NDArray[np.bool_]:
        return off_vessels(network, view, shape)

    return against(
        "pixels off the vessels", "share that differs", (0.0, cpu_ms(ours)),
        **{"cv2.fillConvexPoly": (float((painted() != ours()).mean()), cpu_ms(painted))},
    )  # fmt: skip


def moved() -> dict[str, Any]:
    """A picture moved by part of a pixel: difference from ours, levels."""
    picture = np.random.default_rng(5).uniform(0, 255, (360, 640, 3)).astype(np.float32)
    by = np.array([3.3, -2.71])

    def ours() -> Any:
        return _moved(picture, by)

    def by_scipy() -> Any:
        return ndimage.shift(picture, (by[1], by[0], 0), order=1, mode="nearest")

    def by_cv2() -> Any:
        matrix = np.array([[1, 0, by[0]], [0, 1, by[1]]])
        return cv2.warpAffine(picture, matrix, (640, 360), borderMode=cv2.BORDER_REPLICATE)

    def off(found: Any) -> float:
        return float(np.abs(found - ours()).max())

    return against(
        "simulated camera's move", "levels", (0.0, cpu_ms(ours)),
        **{
            "scipy.ndimage.shift": (off(by_scipy()), cpu_ms(by_scipy)),
            "cv2.warpAffine": (off(by_cv2()), cpu_ms(by_cv2)),
        },
    )  # fmt: skip

"""Camera frames and needle tips by random cameras.

Each camera gets a lens by a board (corners by the checker's
own projection, 0.06 px noise), an insert made with errors, a picture of it, ties to the printer
(crosses touched to 20 µm, or printed squares or a frame, each line laid to 20 µm, found in the
picture), and a bump of 100 µm with marks hidden. Tips are found apart, by a lone camera or by two.
Truth is the checker's (`checkers/dish_camera.py`, `checkers/needle_camera.py`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from benchmarks.checkers.dish_camera import (
    Made,
    Needle,
    Optics,
    Scene,
    aimed,
    developed,
    photograph,
    rough_ground,
    with_needle,
)
from benchmarks.common import Row, limited, row, scratch
from firmware_profiles import load
from firmware_profiles.plates import Dish
from printctl.cli.main import app
from registration.devices.camera_frame import (
    CameraFrame,
    PrintedLine,
    Ties,
    TipView,
    Touch,
    check_frame,
    design_insert,
    find_crossings,
    find_marks,
    find_tip,
    fit_frame,
    grounds,
    locate_tip,
)
from registration.devices.lens import BoardView, Lens, fit_lens
from registration.errors import PictureError

SIZE = (1640, 1232)
WIDE_MM = {"fdm": (2e-3, 0.04), "paper": (1.5e-3, 0.02), "engraved": (3e-4, 0.01)}
CHI95 = 5.991
"""Of two degrees of freedom."""


@dataclass
class Rig:
    """One random camera over one insert."""

    optics: Optics
    made: Made
    scene: Scene
    insert: Any
    target: np.ndarray


def random_rig(rng: np.random.Generator, process: Any) -> Rig:
    """Tilt up to 35°, any turn, distortion, axis off the middle; light, blur, noise at random."""
    insert = design_insert(load(Dish, "petri_60mm"), process=process)
    focal = rng.uniform(1400, 3200)
    target = np.array([rng.uniform(60, 140), rng.uniform(60, 140), rng.uniform(1, 6)])
    away = focal * max(insert.plate_mm) * rng.uniform(1.55, 1.9) / SIZE[1] * 0.82
    tilt = np.radians(rng.uniform(0, 35))
    rotation, centre = aimed(target, away, tilt, rng.uniform(0, 6.28), rng.uniform(0, 6.28))
    half = np.hypot(*SIZE) / 2 / focal
    axis = (np.array(SIZE) - 1) / 2 + rng.normal(0, 0.01, 2) * SIZE[0]
    k = (rng.uniform(-0.08, 0.03) / half**2, rng.uniform(-0.01, 0.01) / half**4)
    p = tuple(rng.normal(0, 4e-4, 2) / half)
    optics = Optics(SIZE, focal, (axis[0], axis[1]), k, (p[0], p[1]), rotation, centre)
    count = len(insert.marks)
    turn = Rotation.from_euler("xyz", [*rng.normal(0, 0.15, 2), rng.normal(0, 1.0)], degrees=True)
    scale, off = WIDE_MM[process]
    made = Made(
        insert.model_dump(mode="json"), rng.normal(0, off, (count, 2)), 1 + rng.normal(0, scale),
        rng.uniform(-0.01, 0.03), turn.as_matrix(), target,
    )  # fmt: skip
    scene = Scene(
        blur=rng.uniform(0.6, 1.5), read=rng.uniform(0.5, 4), full_well=rng.uniform(2000, 12000),
        quality=int(rng.integers(75, 99)), white=rng.uniform(130, 225), black=rng.uniform(15, 50),
        lean=tuple(rng.uniform(-0.25, 0.25, 2)), vignette=rng.uniform(0, 0.4),
        gamma=rng.uniform(0.8, 1.1),
        glare=(*rng.uniform(-0.6, 0.6, 2), 0.12, 90) if rng.random() < 0.4 else None,
    )  # fmt: skip
    return Rig(optics, made, scene, insert, target)


def lens_of(rig: Rig, rng: np.random.Generator, pictures: int = 9) -> Lens:
    """Lens by the product's fit, from corners of a board seen by the checker's camera."""
    x, y = np.meshgrid((np.arange(10) - 4.5) * 8.0, (np.arange(7) - 3.0) * 8.0)
    board = np.column_stack([x.ravel(), y.ravel()])
    views = []
    away = float(np.linalg.norm(rig.optics.centre - rig.target))
    for n in range(pictures):
        tilt = np.radians(0 if n == 0 else rng.uniform(20, 40))
        rotation, centre = aimed(
            rng.uniform(-12, 12, 3) * [1, 1, 0], away * rng.uniform(0.85, 1.1), tilt,
            n * 2.4, rng.uniform(0, 6.28),
        )  # fmt: skip
        camera = replace(rig.optics, rotation=rotation, centre=centre)
        seen = camera.pixels(np.column_stack([board, 0 * board[:, 0]]))
        inside = ((seen > 5) & (seen < np.array(SIZE) - 5)).all(axis=1)
        pixels = seen[inside] + rng.normal(0, 0.06, (int(inside.sum()), 2))
        views.append(BoardView(board[inside], pixels, SIZE))
    return fit_lens(views)


def framed(rig: Rig, lens: Lens, by: str, rng: np.random.Generator, seed: int) -> CameraFrame:
    """Frame by touched crosses (20 µm) or by printed lines found in the picture."""
    z = float(rig.target[2])
    lines = []
    if by != "touched":
        lines = _frame_sides(rig) if by == "frame" else _squares(rig)
        laid = [(np.array(line), rng.normal(0, 0.02, 2)) for line in lines]
        flat = [tuple(_on_plate(rig, end) for end in line + off) for line, off in laid]
        rig.scene = replace(rig.scene, lines=[(a, b, 0.4) for a, b in flat])
    image = photograph(rig.optics, rig.made, rig.scene, seed)
    marks = find_marks(image, rig.insert, lens, f"camera {seed}")
    now = datetime(2026, 11, 25, tzinfo=UTC)
    if by == "touched":
        crosses = rig.insert.crosses
        there = rig.made.world(np.array([[c.x_mm, c.y_mm] for c in crosses]))
        there = there + rng.normal(0, 0.02, there.shape)
        pairs = zip(crosses, there.tolist(), strict=True)
        touches = [Touch(cross.name, x, y, z, u_mm=0.02) for cross, (x, y, z) in pairs]
        return fit_frame(marks, rig.insert, lens, Ties(touches=touches), now)
    guess = rig.target[:2] + rng.uniform(-0.7, 0.7, 2)
    first = fit_frame(marks, rig.insert, lens, Ties(z_mm=z, at_mm=tuple(guess)), now)
    asked = [PrintedLine((*a, z), (*b, z), 0.4) for a, b in lines]
    points = find_crossings(image, first.view, asked)
    return fit_frame(marks, rig.insert, lens, Ties(printed=points, z_mm=z, u_z_mm=0.1), now)


def _frame_sides(rig: Rig) -> list[tuple[np.ndarray, np.ndarray]]:
    """Sides of a square of 30 mm."""
    low, high = rig.target[:2] - 15, rig.target[:2] + 15
    corners = [(low[0], high[1]), (low[0], low[1]), (high[0], low[1]), (high[0], high[1])]
    around = zip(corners, corners[1:] + corners[:1], strict=True)
    return [(np.array(a), np.array(b)) for a, b in around]


def _squares(rig: Rig) -> list[tuple[np.ndarray, np.ndarray]]:
    """The straight lines that `printctl calibrate pattern squares` writes, by its G-code."""
    at = ",".join(f"{value:.3f}" for value in rig.target)
    with scratch() as folder:
        job = folder / "squares.gcode"
        words = f"--needle 22g --width 0.4 --dish petri_60mm --at {at} -o {job}".split()
        done = CliRunner().invoke(app, ["calibrate", "pattern", "squares", *words])
        if done.exit_code != 0:
            raise SystemExit(done.output)
        tip, pushed, lines = np.zeros(3), 0.0, []
        for text in job.read_text().splitlines():
            words_of = dict(re.findall(r"([A-Z])(-?[\d.]+)", text.split(";")[0]))
            if words_of.pop("G", "") not in ("0", "1"):
                continue
            there = np.array([float(words_of.get(a, b)) for a, b in zip("XYZ", tip, strict=True)])
            plunger = float(words_of.get("E", pushed))
            if plunger > pushed and np.linalg.norm(there[:2] - tip[:2]) > 1:
                lines.append((tip[:2].copy(), there[:2].copy()))
            tip, pushed = there, plunger
    return lines


def _on_plate(rig: Rig, place: np.ndarray) -> np.ndarray:
    """Drawn coordinates behind which the camera sees a place (2,) at the plate's height.

    Ink lies where the needle's tip went, in the printer's own plane, not in the tilted plate's.
    """
    way = np.array([*place, rig.target[2]]) - rig.optics.centre
    normal = rig.made.turn[:, 2]
    reach = ((rig.made.origin - rig.optics.centre) @ normal) / (way @ normal)
    met = rig.optics.centre + reach * way - rig.made.origin
    return np.asarray(met @ rig.made.turn[:, :2] / rig.made.scale)


def field_errors(rig: Rig, frame: CameraFrame) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, 2) mm over the 60 mm dish at the marks' height and 3 mm below; mahalanobis²."""
    angle, radius = np.meshgrid(np.linspace(0, 6.28, 13)[:-1], [0.0, 10.0, 20.0, 28.0])
    flat = np.column_stack([(radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()])
    errors, sizes = [], []
    for down in (0.0, 3.0):
        z = float(rig.target[2]) - down
        world = np.column_stack([flat + rig.target[:2], np.full(len(flat), z)])
        pixels = rig.optics.pixels(world)
        off = frame.to_printer(pixels, z) - world[:, :2]
        spread = frame.covariance_mm2(pixels, z)
        errors.append(off)
        sizes.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off))
    return np.concatenate(errors), np.concatenate(sizes)


def bumped(rig: Rig, frame: CameraFrame, rng: np.random.Generator, seed: int) -> bool:
    """Whether a shift of 100 µm is noticed, with a third of the view hidden."""
    way = rng.normal(size=2)
    shift = np.array([*(0.1 * way / np.linalg.norm(way)), 0.0])
    moved = replace(rig.optics, centre=rig.optics.centre + shift)
    scene = replace(rig.scene, hidden=[(*rng.uniform(-0.7, 0.7, 2), 0.35)], glare=None)
    return not check_frame(photograph(moved, rig.made, scene, seed + 1000), frame).holds


def steady(rig: Rig, frame: CameraFrame, rng: np.random.Generator, seed: int) -> bool:
    """Whether another picture of the same scene passes, with a third of the view hidden."""
    scene = replace(rig.scene, hidden=[(*rng.uniform(-0.7, 0.7, 2), 0.35)])
    return check_frame(photograph(rig.optics, rig.made, scene, seed + 2000), frame).holds


def tip_error(rng: np.random.Generator, cameras: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Error of a tip (3,) mm and its uncertainty; None if it isn't found.

    One camera of 5 megapixels and four places, or two of 2 megapixels and two places.
    """
    size = (2592, 1944) if cameras == 1 else (1640, 1232)
    focal, tilt = size[0] * rng.uniform(1.7, 2.6), np.radians(rng.uniform(25, 55))
    outer = float(rng.choice([0.31, 0.41, 0.51]))
    middle = np.array([100.0, 100.0, 10.0])
    offset = rng.uniform(-0.8, 0.8, 3)
    axis = np.array([*rng.normal(0, 0.008, 2), 1.0])
    axis /= np.linalg.norm(axis)
    scene = Scene(
        blur=rng.uniform(0.6, 1.4), quality=int(rng.integers(78, 98)),
        lean=tuple(rng.uniform(-0.2, 0.2, 2)),
    )  # fmt: skip
    look = {"thread": rng.uniform(0, 0.8), "bright": rng.uniform(90, 230),
            "dark": rng.uniform(10, 60), "light": rng.uniform(-0.8, 0.8)}  # fmt: skip
    places = middle + np.array([[-19, -10, 0], [19, 10, 0], [-10, 19, 0], [10, -19, 0.0]])
    places = places if cameras == 1 else places[:2]
    azimuth, views = rng.uniform(0, 6.28), []
    for number in range(cameras):
        turn, roll = azimuth + 1.7 * number, rng.uniform(0, 6.28)
        rotation, centre = aimed(middle, focal * 66 / size[0], tilt, turn, roll)
        at_half = (size[0] / 2 + 9.0, size[1] / 2 - 7.0)
        optics = Optics(size, focal, at_half, (-0.1, 0.03), (5e-4, -4e-4), rotation, centre)
        frame = _known(optics, rng)
        ground = rough_ground(size, rng, rng.uniform(50, 210), rng.uniform(2, 14))
        needles = [Needle(at + offset, outer, axis, **look) for at in places]
        pictures = [developed(with_needle(optics, ground, one), scene, rng) for one in needles]
        behind = grounds(pictures, frame, places, outer, 2.0)
        for picture, at, back in zip(pictures, places, behind, strict=True):
            try:
                seen = find_tip(picture, frame, at, outer, ground=back, length_mm=12.7)
            except PictureError:
                continue
            views.append(TipView(frame, seen, at))
    if len(views) < 2:
        return None
    try:
        found = locate_tip(views, outer)
    except PictureError:
        return None
    return found.offset_mm - offset, found.u_mm


def _known(optics: Optics, rng: np.random.Generator) -> CameraFrame:
    """The checker's own camera as a frame that is told to be, and is, good to 5 µm."""
    from registration.devices.camera_frame.frame import SeenAtFit, turn_vector

    lens = Lens(
        size_px=optics.size, focal_px=optics.focal, centre_px=optics.axis,
        distortion=(*optics.k, *optics.p, 0.0), um_per_px=30.0, um_per_px_95=(29.0, 31.0),
        off_px=0.05,
    )  # fmt: skip
    eye: Any = (optics.centre + rng.normal(0, 5e-3, 3)).tolist()
    turn: Any = tuple(map(float, turn_vector(optics.rotation)))
    spread = np.diag([1e-7] * 3 + [5e-3] * 3 + [1e-9] * 8) ** 2
    return CameraFrame(
        made=datetime(2026, 11, 25, tzinfo=UTC), tied="touched", lens=lens,
        turn_vector=turn,
        eye_mm=tuple(eye),
        covariance=tuple(tuple(map(float, one)) for one in spread),
        middle_mm=(100.0, 100.0, 10.0), insert=design_insert(load(Dish, "petri_60mm")),
        marks_z_slope=(0.0, 0.0), off_px=0.0, insert_scale=1.0,
        seen=SeenAtFit(numbers=(), corners_px=(), u_px=0.0, blur_px=1.0, black=0.1, white=0.8),
    )  # fmt: skip


def rows(quick: bool) -> Iterator[Row]:
    """Yield cameras that take turns with the ways of tying and making, then needle tips."""
    ways = (
        ("touched", "engraved"), ("squares", "engraved"), ("frame", "engraved"), ("squares", "fdm"),
    )  # fmt: skip
    count = 1 if quick else 50
    found: dict[Any, list[tuple[np.ndarray, np.ndarray]]] = {way: [] for way in ways}
    noticed, passed, failed = [], [], []
    for seed in range(count):
        by, process = ways[seed % 4]
        rng = np.random.default_rng([seed, 26])
        rig = random_rig(rng, process)
        try:
            frame = framed(rig, lens_of(rig, rng), by, rng, seed)
        except PictureError as exc:
            failed.append(f"{by} {process} {seed}: {exc}")
            continue
        found[by, process].append(field_errors(rig, frame))
        if seed % 2 == 0:
            noticed.append(bumped(rig, frame, rng, seed))
            passed.append(steady(rig, frame, rng, seed))
    for way, ones in found.items():
        if ones:
            yield _frame_row(f"{way[1]} insert, {way[0]}, {len(ones)} cameras", ones)
    yield row("pictures in which no frame is found", len(failed), "") | {"which": failed}
    share = float(np.mean(noticed))
    yield row("bumps of 100 µm noticed, view partly hidden", share, "", "1", all(noticed))
    yield row("same scene, view partly hidden: holds", float(np.mean(passed)), "")
    yield from (tip_row(1 if quick else count, cameras) for cameras in (1, 2))


def _frame_row(name: str, found: list[tuple[np.ndarray, np.ndarray]]) -> Row:
    far = 1e3 * np.linalg.norm(np.concatenate([one[0] for one in found]), axis=1)
    size = np.concatenate([one[1] for one in found])
    more = {"rms_um": float(np.sqrt((far**2).mean())), "worst_um": float(far.max())}
    more["truth_within_95_percent"] = float((size < CHI95).mean())
    return limited(f"{name}: 95 %", float(np.percentile(far, 95)), "µm", 30.0) | more


def tip_row(count: int, cameras: int) -> Row:
    """Return the row of the needle's tip."""
    found = [tip_error(np.random.default_rng([seed, 77]), cameras) for seed in range(count)]
    good = [one for one in found if one is not None]
    off = np.array([one[0] for one in good])
    far = 1e3 * np.linalg.norm(off, axis=1)
    within = np.abs(off) < 2 * np.array([one[1] for one in good])
    name = "one camera of 5 MP, four places" if cameras == 1 else "two of 2 MP, two places"
    more = {"rms_um": float(np.sqrt((far**2).mean())), "not_found": count - len(good)}
    more["axes_within_2_u"] = float(within.mean())
    high = float(np.percentile(far, 95))
    return limited(f"needle's tip, {name}, {count} times: 95 % in space", high, "µm", 20.0) | more

"""Make films of a network: its growth, or a pressure or flow pulse through it.

Goes in: a run folder or a network. Comes out: frames, and a film file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from design.files import atomic_replacement
from design.geometry.polyline import arc_lengths
from design.hemodynamics import (
    PulsatileConditions,
    pulsatile_at_probes,
    solve_one_d,
    solve_pulsatile,
)
from design.hemodynamics.probes import Probes, ProbeWaves
from design.measures.growth_order import GrowthOrder, growth_order
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from gcode.errors import SimError
from kernels.arrays import FloatArray
from printctl.analysis.flow import one_d_options, pulsatile_conditions
from printctl.errors import UsageError
from printctl.recipe import Recipe
from printctl.recipe.parts import OneDPart
from registration.measuring.gauging import sub_network
from report.picture import DrivingWave, FilmScene, Quantity, magnitude

CODES: Final = {".mp4": "mp4v", ".mov": "mp4v", ".avi": "MJPG"}
"""OpenCV's codec of each suffix."""
SUFFIXES: Final = (*CODES, ".gif", ".webp")
Frame = NDArray[np.uint8]
_QUALITY: Final = 80


def check_suffix(path: Path) -> None:
    """Raise `UsageError` when a film can't be written under this name."""
    if path.suffix.lower() not in SUFFIXES or path.is_dir():
        raise UsageError(f"{path}: give the name of a film, ending in {', '.join(SUFFIXES)}")


def write_frames(
    path: Path, frames: Iterable[NDArray[np.uint8]], size: tuple[int, int], fps: float
) -> None:
    """Write frames (height, width, 3; blue, green, red) of ``size`` (width, height).

    A film that breaks off leaves no file.

    Raises
    ------
    SimError
        When the suffix isn't known, or the file can't be written.
    """
    if path.suffix.lower() not in CODES:
        raise SimError(f"{path}: a film is written as {', '.join(CODES)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.stem}.part{path.suffix}")
    code = cv2.VideoWriter.fourcc(*CODES[path.suffix.lower()])
    writer = cv2.VideoWriter(str(draft), code, fps, size)
    try:
        if not writer.isOpened():
            raise SimError(f"{path}: OpenCV can't write this film; try .avi")
        for frame in frames:
            writer.write(frame)
        writer.release()
        draft.replace(path)
    finally:
        writer.release()
        draft.unlink(missing_ok=True)


def write_film(path: Path, frames: Iterator[Frame], fps: float) -> int:
    """Write frames (height, width, 3), red, green, blue, of one size; how many there were.

    Raises
    ------
    UsageError
        As `check_suffix`.
    SimError, OSError
        When the file can't be written.
    """
    check_suffix(path)
    first = next(frames)
    every = chain([first], frames)
    if path.suffix.lower() in CODES:
        count = 0

        def counted() -> Iterator[Frame]:
            nonlocal count
            for frame in every:
                count += 1
                yield np.ascontiguousarray(frame[:, :, ::-1])

        write_frames(path, counted(), (first.shape[1], first.shape[0]), fps)
        return count
    return _animated(path, [Image.fromarray(frame) for frame in every], fps)


def _animated(path: Path, images: list[Image.Image], fps: float) -> int:
    """An animated picture that begins anew at its end."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".gif":
        # One palette for all frames, of those that show most: the last.
        palette = images[-1].quantize(256, Image.Quantize.MEDIANCUT)
        images = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in images]
    with atomic_replacement(path) as draft:
        images[0].save(
            draft,
            format=path.suffix[1:].upper(),
            save_all=True,
            append_images=images[1:],
            duration=round(1000.0 / fps),
            loop=0,
            **({"quality": _QUALITY} if path.suffix.lower() == ".webp" else {"disposal": 1}),
        )
    return len(images)


By = Literal["terminals", "generations"]


@dataclass(frozen=True)
class GrowthFilm:
    """Settings of a film of growth.

    Attributes
    ----------
    by : "terminals" or "generations"
    steps : int
        Frames of growth by terminals; each generation is a step of its own.
    hold : int
        Frames that each generation, and the whole at the end, stands for.
    murray_exponent : float
        By which vessels are thinner while fewer terminals are there.
    """

    by: By = "terminals"
    steps: int = 60
    hold: int = 12
    murray_exponent: float = 3.0


def growth_frames(scene: FilmScene, quantity: Quantity, film: GrowthFilm) -> Iterator[Frame]:
    """Draw each step, then the whole network for a while.

    Raises
    ------
    UsageError
        For growth by terminals of a network that isn't trees.
    """
    network = scene.whole
    order = growth_order(network)
    if film.by == "generations":
        yield from _generations(scene, quantity, order, film)
        return
    if order.terminal is None:
        raise UsageError(
            "the network has loops that no connections close, so that no terminals came one by "
            "one; give --by generations"
        )
    total = _terminal_count(order)
    radius = quantity.key == "radius"
    frame: Frame | None = None
    for step in range(1, film.steps + 1):
        # As many in the first frames as can be followed by eye.
        count = max(1, round(total * (step / film.steps) ** 2))
        part = order.drawn(count / total)
        shown = part ** (1.0 / film.murray_exponent)
        frame = scene.frame(
            *_drawn(network, quantity, shown, radius),
            f"{count} of {total} terminals{_per_tree(order)}",
        )
        yield frame
    if frame is not None:
        yield from (frame for _ in range(film.hold))


def _generations(
    scene: FilmScene, quantity: Quantity, order: GrowthOrder, film: GrowthFilm
) -> Iterator[Frame]:
    last = int(order.generation.max())
    for number in range(last + 1):
        there = (order.generation <= number).astype(np.float64)
        count = int(there.sum())
        caption = f"generation {number} of {last}: {count} of {len(there)} vessels"
        frame = scene.frame(*_drawn(scene.whole, quantity, there, False), caption)
        yield from (frame for _ in range(film.hold))


def _terminal_count(order: GrowthOrder) -> int:
    """Terminals of the tree that has most."""
    if order.terminal is None or order.parent is None:
        return 0
    came = order.terminal[np.isfinite(order.terminal)]
    return max(1, round(1.0 / float(came.min())))


def _per_tree(order: GrowthOrder) -> str:
    trees = 0 if order.parent is None else int((order.parent < 0).sum())
    return "" if trees < 2 else " of the largest tree"


def _drawn(
    network: VesselNetwork, quantity: Quantity, shown: FloatArray, as_wide: bool
) -> tuple[VesselNetwork, Quantity]:
    """The vessels that are there, radii times ``shown`` (v,), and the quantity's values there."""
    kept = np.flatnonzero(shown > 0.0)
    part, _ = sub_network(network, kept)
    points = np.repeat(shown > 0.0, np.diff(network.offset))
    radius = part.radius * np.repeat(shown[kept], np.diff(part.offset))
    values = quantity.values[points if quantity.at_points(network) else kept]
    coloured = replace(quantity, values=radius if as_wide else values)
    return replace(part, radius=radius), coloured


_WAVE = 200
"""Points of the inlet's wave as it is drawn."""
_MMHG_FROM = 1.0
"""Pulses of less pressure than this, mmHg, are shown in Pa."""


@dataclass(frozen=True)
class PulseFilm:
    """Settings of a film of a pulse.

    Attributes
    ----------
    shown : "pressure" or "flow"
    solver : "0d" or "1d"
    frames : int
        Of a cycle.
    cycles : int
        The film's length.
    """

    shown: Literal["pressure", "flow"] = "pressure"
    solver: Literal["0d", "1d"] = "0d"
    frames: int = 50
    cycles: int = 2


def pulse_frames(
    scene: FilmScene, recipe: Recipe, tables: Path, film: PulseFilm
) -> Iterator[Frame]:
    """Solve for the periodic state that the recipe asks for, and draw it over its cycles.

    Parameters
    ----------
    scene : FilmScene
        Of the run's network.
    recipe : Recipe
        With ``flow.pulse``; ``tables`` is the folder that names of its tables are relative to.

    Raises
    ------
    UsageError
        Without a pulse, or for 1D without walls that give way.
    FlowError, OSError
        As the solvers, and for tables that can't be read.
    """
    network, pulse = scene.whole, recipe.flow.pulse
    if pulse is None:
        raise UsageError(
            "the run's recipe has no pulse to film; add flow: {pulse: ...} and run it again, or "
            "film --show growth"
        )
    conditions = pulsatile_conditions(recipe.flow, pulse, tables, recipe.print_scale, network)
    places = _places(network)
    waves = _solved(network, conditions, recipe.flow.one_d, places, film)
    quantity = _quantity(waves, film.shown)
    driving = _driving(conditions)
    cycle = []
    for k, time in enumerate(waves.time_s.tolist()):
        now = replace(quantity, values=quantity.values[:, k])
        caption = f"{film.solver.upper()} flow, t = {time:.3f} s of {driving.period_s:g} s"
        above = scene.frame(network, now, caption)
        below = scene.strip(driving, time)
        cycle.append(np.vstack([above, below[:, : above.shape[1]]]))
        yield cycle[-1]
    for _ in range(film.cycles - 1):
        yield from cycle


def _places(network: VesselNetwork) -> Probes:
    """Every point of the polylines."""
    vessel = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    along = arc_lengths(network.points)
    begin, end = along[network.offset[:-1]], along[network.offset[1:] - 1]
    share = (along - begin[vessel]) / (end - begin)[vessel]
    return Probes(vessel, np.clip(share, 0.0, 1.0))


def _solved(
    network: VesselNetwork,
    conditions: PulsatileConditions,
    part: OneDPart | None,
    places: Probes,
    film: PulseFilm,
) -> ProbeWaves:
    if film.solver == "0d":
        solution = solve_pulsatile(network, conditions, 2 * film.frames)
        return pulsatile_at_probes(network, solution, conditions, places, film.frames)
    options = replace(one_d_options(part or OneDPart(), film.frames), probes=places)
    waves = solve_one_d(network, conditions, options).probes
    if waves is None:
        raise UsageError("1D flow gave no waves along the vessels; film --solver 0d")
    return waves


def _quantity(waves: ProbeWaves, shown: str) -> Quantity:
    """The values (p, t), on one scale for all times."""
    quantity: Quantity | None
    if shown == "flow":
        quantity = magnitude("flow", "Flow", "mL/min", np.abs(waves.flow) / UL_S_PER_ML_MIN)
    else:
        low = float(np.abs(waves.pressure).max()) < _MMHG_FROM * PA_PER_MMHG
        values: FloatArray = waves.pressure if low else waves.pressure / PA_PER_MMHG
        quantity = magnitude("pressure", "Pressure", "Pa" if low else "mmHg", values, log=False)
    if quantity is None:
        raise UsageError("the pulse has no number to show; check flow.pulse")
    return quantity


def _driving(conditions: PulsatileConditions) -> DrivingWave:
    """What drives the inlets."""
    period = conditions.inlet.period_s or 1.0
    time = period * np.arange(_WAVE) / _WAVE
    by_flow = conditions.inlet_is == "flow"
    unit = UL_S_PER_ML_MIN if by_flow else PA_PER_MMHG
    title = "Inlet flow / mL/min" if by_flow else "Inlet pressure / mmHg"
    return DrivingWave(time, conditions.inlet.at(time) / unit, title, period)

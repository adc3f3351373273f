"""Simulated camera and OCT of a print that goes on: cost of a look, places, missing ink.

Places are held against OpenCV's projection and a root finder's Snell; missing ink against
arithmetic, in picture and scan alike: ``python -m benchmarks.observe_camera``, one CPU minute.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from scipy.optimize import brentq

from benchmarks.command import Job, run
from benchmarks.machine import ROOT, row
from sim.devices.camera.optics import Camera
from sim.devices.camera.paint import paint
from sim.devices.camera.scene import Bath, InkLook, Light, Scene, Sensor
from sim.gcode.deposit.ink_faults import Clog, InkFaults
from sim.gcode.deposit.lay import deposit_of_laid, laid, laid_as_is
from sim.gcode.deposit.strands import Strands
from sim.gcode.motion.executed import ExecutedMotion

Row = dict[str, Any]
PITCH, WIDTH, HEIGHT, AREA, INDEX = 0.5, 0.25, 0.1, 4.15, 1.33
CLEAR = Scene(
    bath=Bath(texture=0, colour=(90, 90, 90), turbidity_per_mm=0.05, refractive_index=INDEX),
    ink=InkLook(colour=(210, 210, 210), edge=0, relief=0),
    light=Light(uneven=0),
    sensor=Sensor(vignetting=0, blur_px=0.5, read_noise=0, full_well=1e6, mono=True),
)


def record(side: float, layers: int) -> ExecutedMotion:
    """Lines there and back in every layer, along x and y in turn, about (100, 100)."""
    places, volumes = [(90.0, 90.0, HEIGHT)], []
    for layer in range(layers):
        for number in range(round(side / PITCH)):
            across = 100 - side / 2 + (number + 0.5) * PITCH
            ends = [100 - side / 2, 100 + side / 2][:: 1 if number % 2 else -1]
            for end, volume in zip(ends, (0.0, side * WIDTH * HEIGHT), strict=True):
                x, y = (end, across) if layer % 2 else (across, end)
                places.append((x, y, (layer + 1) * HEIGHT))
                volumes.append(volume)
    at, plunger = np.array(places), np.concatenate([[0.0], np.cumsum(volumes)]) / AREA
    time = np.arange(len(at), dtype=float)
    numbers = np.arange(len(volumes))
    return ExecutedMotion(at[:-1], at[1:], plunger[:-1], plunger[1:], time[:-1], time[1:], numbers)


def cost_rows(quick: bool) -> Iterator[Row]:
    """CPU time and memory of one look, a process each."""
    source = {"printer": "generic_marlin", "syringe": "hamilton_1ml"}
    camera = {"size_px": [3280, 2464], "um_per_px": 10, "target_mm": [100, 100, 2]}
    scene = {"bath": {"surface_z_mm": 3}, "light": {"glare": 1}, "clutter": {"bubbles_per_cm2": 2}}
    box = {"low_mm": [95, 95, 1], "high_mm": [105, 105, 2.12]}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        record(20.0, 20).save(folder / "executed.npz")
        told = {"camera": {"camera": camera, "scene": scene, "laid": source}}
        told["oct"] = box | {"voxel_um": [20, 20, 15], "laid": source}
        for device, what in (("camera", "8 megapixels"), ("oct", "OCT of 500 x 500 x 100")):
            (folder / "device.yaml").write_text(yaml.safe_dump(told[device]))
            costs = [_cost(folder, device) for _ in range(1 if quick else 3)]
            cpu, memory = np.min(costs, axis=0)
            yield row(f"one look, {what}, whole process", round(cpu, 2), "CPU s")
            yield row(f"one look, {what}, most memory", round(memory / 1e3, 2), "GB")


def _cost(folder: Path, device: str) -> tuple[float, float]:
    """CPU seconds and peak MB of a look, told by the process itself."""
    words = [device, "--record", folder / "executed.npz", f"--{device}", folder / "device.yaml"]
    words += ["--out", folder / ("seen.png" if device == "camera" else "seen.npz")]
    text = (
        "import sys, time; from benchmarks.machine import peak_mb; from sim.__main__ import main; "
        "code = main(sys.argv[1:]); print(time.process_time(), peak_mb()); sys.exit(code)"
    )
    command = [sys.executable, "-c", text, *map(str, words)]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    cpu, memory = map(float, done.stdout.split())
    return cpu, memory


def place_rows(quick: bool) -> Iterator[Row]:
    """Errors of lines' places in pictures of random cameras, some through a bath's surface."""
    generator = np.random.default_rng(4)
    errors = []
    for _ in range(4 if quick else 20):
        camera = _camera(generator)
        surface = 3.0 if generator.random() < 0.5 else None
        bath = CLEAR.bath.model_copy(update={"surface_z_mm": surface})
        turn, z = generator.uniform(0, np.pi), generator.uniform(1, 2)
        way = np.array([np.cos(turn), np.sin(turn), 0.0])
        begin = np.array([100, 100, z]) + [*generator.uniform(-0.5, 0.5, 2), 0] - 2 * way
        picture = paint(
            _line(begin, begin + 4 * way), camera, CLEAR.model_copy(update={"bath": bath}), 1
        )
        places = begin + np.linspace(0.1, 0.9, 60)[:, None] * 4 * way
        errors.append(_off(picture, _seen(camera, places, surface)))
    found = np.concatenate(errors)
    yield row("lines in pictures, place, rms", round(float(np.sqrt((found**2).mean())), 3), "px")
    yield row("lines in pictures, place, largest mean of a picture",
              round(max(abs(float(one.mean())) for one in errors), 3), "px", "<= 0.1",
              max(abs(float(one.mean())) for one in errors) <= 0.1)  # fmt: skip


def _camera(generator: np.random.Generator) -> Camera:
    return Camera(
        size_px=(640, 480),
        um_per_px=generator.uniform(10, 20),
        target_mm=(100, 100, 1.5),
        distance_mm=generator.uniform(60, 200),
        tilt_deg=generator.uniform(0, 25),
        tilt_towards_deg=generator.uniform(0, 360),
        turn_deg=generator.uniform(-180, 180),
        distortion=(*generator.uniform(-1, 1, 2), *generator.uniform(-0.002, 0.002, 2), 0.0),
    )


def _line(begin: np.ndarray, end: np.ndarray) -> Any:
    area, none = np.array([np.pi / 4 * WIDTH**2]), np.zeros(1, np.int64)
    dose = area * np.linalg.norm(end - begin)
    return laid_as_is(Strands(begin[None], end[None], dose, area, none, none), "embedded")


def _seen(camera: Camera, places: np.ndarray, surface: float | None) -> np.ndarray:
    """Pixels of places, by OpenCV; through a surface by a root of Snell's law."""
    aims = places.copy()
    for row_number in range(len(places) if surface is not None else 0):
        eye, place = camera.eye_mm, places[row_number]
        far, high, deep = np.hypot(*(place - eye)[:2]), eye[2] - surface, surface - place[2]

        def off(a: float, far: float = far, high: float = high, deep: float = deep) -> float:
            return float(np.sin(np.arctan2(a, high)) - INDEX * np.sin(np.arctan2(far - a, deep)))

        share = brentq(off, 0, far) / far
        aims[row_number] = [*(eye[:2] + share * (place - eye)[:2]), surface]
    focal, (u, v) = camera.focal_px, camera.centre_px
    matrix = np.array([[focal, 0, u], [0, focal, v], [0, 0, 1]])
    turn = cv2.Rodrigues(camera.axes)[0]
    shift = -camera.axes @ camera.eye_mm
    seen = cv2.projectPoints(aims, turn, shift, matrix, np.array(camera.distortion))[0]
    return np.asarray(seen[:, 0])


def _off(picture: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """How far beside pixels a line's middle is seen, px."""
    way = pixels[-1] - pixels[0]
    step = np.arange(-25, 25, 0.1)
    at = pixels[:, None] + step[:, None] * np.array([-way[1], way[0]]) / np.hypot(*way)
    u, v = (np.ascontiguousarray(at[..., k], np.float32) for k in range(2))
    ink = np.maximum(cv2.remap(picture.astype(np.float32), u, v, cv2.INTER_LINEAR) - 93, 0)
    return np.asarray((ink * step).sum(axis=1) / ink.sum(axis=1))


def fault_rows(quick: bool) -> Iterator[Row]:
    """Stations of a layer at which picture or scan differ from arithmetic about missing ink."""
    generator = np.random.default_rng(5)
    motion, side = record(6.0, 3), 6.0
    camera = Camera(size_px=(800, 800), um_per_px=10, target_mm=(100, 100, 0.3))
    first = 2 * round(side / PITCH) * side
    wrong_picture = wrong_scan = stations = 0
    for _ in range(5 if quick else 25):
        begin = first + generator.uniform(0, 0.7) * first / 2
        length = generator.uniform(0.2, 8)
        clog = Clog(fault="clog", written_mm=begin, lasts_mm=length)
        ink = laid(motion, InkFaults((clog,)), AREA, plunger_step_mm=1e-6)
        lower = ink.strands.end[:, 2] > 2.5 * HEIGHT
        top = laid_as_is(_rows(ink.strands, lower), "layered", layer_mm=HEIGHT)
        picture, voxels = paint(top, camera, CLEAR, 1), deposit_of_laid(top, 0.02)
        way = np.arange(0.05, first / 2, 0.1)
        places, missing = (
            _stations(way, side),
            (way > begin - first) & (way < begin - first + length),
        )
        sure = np.minimum(abs(way - begin + first), abs(way - begin + first - length)) > WIDTH
        sure &= np.minimum(way % side, side - way % side) > WIDTH
        u, v = np.round(camera.pixels(places)).astype(int).T
        x, y, z = np.round((places - voxels.origin_mm) / 0.02).astype(int).T
        wrong_picture += int(((picture[v, u] < 95) != missing)[sure].sum())
        wrong_scan += int(((voxels.volume[z - 2, y, x] < 128) != missing)[sure].sum())
        stations += int(sure.sum())
    yield row("stations of layers with a clog", stations, "")
    yield row("of these shown wrongly by the picture", wrong_picture, "", "0", wrong_picture == 0)
    yield row("of these shown wrongly by the deposit", wrong_scan, "", "0", wrong_scan == 0)


def _rows(strands: Strands, chosen: np.ndarray) -> Strands:
    names = ("start", "end", "dose_ul", "area_mm2", "stroke", "line")
    return Strands(*(getattr(strands, name)[chosen] for name in names))


def _stations(way: np.ndarray, side: float) -> np.ndarray:
    """Places along the lines of the third layer, (n, 3), mm."""
    number, along = (way // side).astype(int), way % side
    across = 100 - side / 2 + (number + 0.5) * PITCH
    end = np.where(number % 2 == 1, 100 - side / 2 + along, 100 + side / 2 - along)
    return np.column_stack([across, end, np.full(len(way), 3 * HEIGHT)])


JOBS: dict[str, Job] = {"cost": cost_rows, "places": place_rows, "faults": fault_rows}


if __name__ == "__main__":
    run(JOBS, __doc__)

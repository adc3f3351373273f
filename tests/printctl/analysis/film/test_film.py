"""Films of growth and of a pulse, read back frame by frame."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from rich.console import Console
from typer.testing import CliRunner

from printctl.cli.main import app
from printctl.pipeline.run import design_recipe
from printctl.recipe import parse_recipe

FOREST: dict[str, Any] = {
    "schema": 1,
    "name": "filmed",
    "tissue": {"shape": "block", "size_mm": [12, 10, 8]},
    "vasculature": {
        "grow": "forest",
        "terminals": 8,
        "networks": [
            {"trees": [{"kind": "artery"}, {"kind": "vein"}]},
            {"trees": [{"kind": "lymph", "terminals": 4}]},
        ],
    },
    "flow": {
        "supplies": [{"trees": [2], "flow_ml_min": 0.01}],
        "pulse": {"amplitude_ml_min": 0.2, "period_s": 1},
    },
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("filmed")
    recipe = parse_recipe(FOREST, "filmed.yaml")
    design_recipe(recipe, folder, folder / "run", Console(file=io.StringIO()), until="flow")
    return folder / "run"


def filmed(*words: str) -> Any:
    return CliRunner().invoke(app, ["film", *words], catch_exceptions=True)


def ink(image: np.ndarray) -> int:
    """Pixels of the picture's left part, without its key, that are far from grey."""
    part = image[40:-40, : 2 * image.shape[1] // 3].astype(int)
    return int((np.ptp(part, axis=2) > 60).sum())


def test_growth_adds_vessels_frame_by_frame(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "growth.gif"
    done = filmed(str(run), "--steps", "4", "--width", "400", "--out", str(out))
    assert done.exit_code == 0, done.output
    with Image.open(out) as film:
        frames = []
        for number in range(film.n_frames):
            film.seek(number)
            frames.append(ink(np.asarray(film.convert("RGB"))))
    assert frames[0] > 0
    assert frames[0] < frames[1] < frames[-1]


def test_a_pulse_returns_to_where_it_began(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "pulse.mp4"
    words = ["--show", "pulse", "--frames", "8", "--cycles", "2", "--width", "300"]
    done = filmed(str(run), *words, "--out", str(out))
    assert done.exit_code == 0, done.output
    film = cv2.VideoCapture(str(out))
    frames = []
    while True:
        read, frame = film.read()
        if not read:
            break
        frames.append(frame[: frame.shape[0] // 2].astype(int))
    assert len(frames) == 16
    assert np.abs(frames[2] - frames[6]).mean() > 2 * np.abs(frames[2] - frames[10]).mean()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--show", "pulse", "--by", "generations"), "--by is for --show growth"),
        (("--out", "film.txt"), "ending in"),
        (("--colour", "taste"), "Invalid value"),
    ],
)
def test_what_would_do_nothing_is_refused(run: Path, words: tuple[str, ...], said: str) -> None:
    done = filmed(str(run), *words)
    assert done.exit_code != 0
    assert said in f"{done.output} {done.exception}"

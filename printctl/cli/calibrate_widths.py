"""`printctl calibrate widths`: ink constants from a calibration print's widths or picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from design.files import write_bytes, write_text
from firmware_profiles import Ink, load
from printctl.calibration.patterns import COLUMNS, WrittenPattern, read_pattern
from printctl.calibration.widths import (
    Answer,
    GivenValues,
    MeasuredPicture,
    PictureFacts,
    fit_replies,
    fit_widths,
    measure_picture,
    typed_replies,
    typed_widths,
)
from printctl.cli.calibrate_files import MeasuredValue, write_measured
from printctl.cli.calibrate_options import CameraFile, Write, numbers_of, print_estimates
from printctl.cli.options import JsonFlag, messages, print_lines
from printctl.errors import UsageError
from registration.devices.lens import read_lens

_CORNERS = 4


def widths(
    file: Annotated[
        Path, typer.Argument(help="The sheet, filled in (.csv), or a picture.", show_default=False)
    ],
    pattern: Annotated[
        Path | None,
        typer.Option("--pattern", help="The pattern's .json; FILE's name with .json if not."),
    ] = None,
    um_per_px: Annotated[
        float | None,
        typer.Option(
            "--um-per-px", min=0.01, max=1000, help="By a stage micrometer, not the frame."
        ),
    ] = None,
    marks: Annotated[
        str | None,
        typer.Option(
            "--marks",
            metavar="U,V,…",
            help="Pixels of the frame's corners where it isn't found: lower left, lower right, "
            "upper right, upper left, as on the drawing.",
        ),
    ] = None,
    camera: CameraFile = None,
    flow_factor: Annotated[
        float | None,
        typer.Option("--flow-factor", min=0.2, max=5, help="Weighed; the swelling is told then."),
    ] = None,
    ink: Annotated[
        str | None, typer.Option("--ink", help="For --write; the one it was printed with if not.")
    ] = None,
    write: Write = None,
    as_json: JsonFlag = False,
) -> None:
    """Widths of a calibration print, and what they say of the ink.

    Of a picture it writes, beside it, NAME.measured.png to judge by, and NAME.widths.csv.
    """
    typed = file.suffix.lower() == ".csv"
    if typed and (um_per_px is not None or marks is not None or camera is not None):
        raise UsageError(
            "--um-per-px, --marks and --camera are of a picture; a sheet has its widths in mm"
        )
    if um_per_px is not None and camera is not None:
        raise UsageError("--camera has the scale: leave --um-per-px out, or --camera")
    written = _pattern(file, pattern)
    known = GivenValues(flow_factor)
    if written.pattern.name not in ("lines", "spiral") and flow_factor is not None:
        raise UsageError(f"--flow-factor belongs to lines or a spiral; this is a {_name(written)}")
    notes: list[str] = []
    if typed:
        answer = _from_sheet(file, written, known)
    else:
        seen = measure_picture(
            file,
            written,
            PictureFacts(um_per_px, _corners(marks), None if camera is None else read_lens(camera)),
        )
        _keep(file, seen)
        notes = seen.notes
        answer = _from_picture(seen, written, known)
    if not as_json:
        print_lines(*answer.table)
    print_estimates(dict(answer.estimates), [*notes, *answer.notes], as_json)
    if write is not None:
        _write(write, answer, load(Ink, ink or written.mounted.ink))


def _pattern(file: Path, named: Path | None) -> WrittenPattern:
    if not file.is_file():
        raise UsageError(f"{file} doesn't exist; give the sheet (.csv) or a picture")
    if named is None:
        named = file.with_suffix(".json")
        if not named.is_file():
            raise UsageError(
                f"{named} isn't there: name the file that `printctl calibrate pattern` wrote "
                "beside the G-code (--pattern)"
            )
    written = read_pattern(named)
    if written.pattern.name not in COLUMNS:
        raise UsageError(
            f"{named} is a pattern of {written.pattern.name}, which ties a camera to the printer "
            "and has no widths to read; use printctl observe frame --printed"
        )
    return written


def _name(written: WrittenPattern) -> str:
    return f"pattern of {written.pattern.name}"


def _corners(text: str | None) -> np.ndarray | None:
    if text is None:
        return None
    values = numbers_of(text.replace(";", ","), "--marks")
    if len(values) != 2 * _CORNERS:
        raise UsageError(
            f"--marks {text!r} has {len(values)} numbers; give {2 * _CORNERS}: u,v of the lower "
            "left, lower right, upper right and upper left corner"
        )
    return np.array(values).reshape(_CORNERS, 2)


def _from_sheet(file: Path, written: WrittenPattern, known: GivenValues) -> Answer:
    if written.pattern.name in ("lines", "spiral"):
        return fit_widths(written, typed_widths(file, written), known)
    return fit_replies(written, typed_replies(file, written))


def _from_picture(seen: MeasuredPicture, written: WrittenPattern, known: GivenValues) -> Answer:
    if seen.widths is not None:
        return fit_widths(written, seen.widths, known)
    assert seen.replies is not None  # one of the two
    return fit_replies(written, seen.replies)


def _keep(file: Path, seen: MeasuredPicture) -> None:
    """Write the annotated picture and the filled sheet beside the picture."""
    drawn, table = file.with_suffix(".measured.png"), file.with_suffix(".widths.csv")
    _, data = cv2.imencode(".png", seen.picture)
    write_bytes(drawn, data.tobytes())
    write_text(table, seen.table)
    messages().print(f"wrote {drawn} (judge by it) and {table}", markup=False)


def _write(path: Path, answer: Answer, ink: Ink) -> None:
    if not answer.changes:
        raise UsageError(f"{path} isn't written: this print tells nothing that a profile holds")
    write_measured(
        path, ink, {key: MeasuredValue(one.value, one.said) for key, one in answer.changes.items()}
    )

"""`printctl observe`: group of subcommands for the camera that watches prints."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from printctl.cli.observe_frame import frame
from printctl.cli.observe_insert import insert
from printctl.cli.observe_looks import answer, looks
from printctl.cli.observe_options import FrameFile, LimitOption
from printctl.cli.observe_sweep import sweep
from printctl.cli.observe_tip import tip
from printctl.cli.options import JsonFlag, print_json, print_lines
from registration.devices.camera_frame import check_frame, read_frame
from registration.devices.camera_frame.check import LIMIT_UM
from registration.devices.lens.board import decoded

# `printctl observe check`: detect a moved camera or insert from the marks in one picture.


def check(
    picture: Annotated[Path, typer.Argument(help="Picture of the insert.", show_default=False)],
    frame: FrameFile,
    limit_um: LimitOption = LIMIT_UM,
    as_json: JsonFlag = False,
) -> None:
    """Compare a picture's marks with the frame's: a bumped camera, a moved insert, another focus.

    Marks may be hidden, as long as four around the dish are seen.
    """
    held = read_frame(frame)
    answer = check_frame(decoded(picture), held, picture, limit_um)
    age = held.age_days(datetime.now(UTC))
    if as_json:
        number = {"moved_um": answer.moved_um, "u_um": answer.u_um}
        print_json({
            "holds": answer.holds, "marks": answer.marks, "why": answer.why,
            "notes": answer.notes, "age_days": age,
            **{name: one if math.isfinite(one) else None for name, one in number.items()},
        })  # fmt: skip
    else:
        moved = (
            "" if math.isnan(answer.moved_um)
            else f": moved {answer.moved_um:.0f} µm at the dish (± {2 * answer.u_um:.0f} µm), "
            f"{answer.marks} marks"
        )  # fmt: skip
        verdict = "holds" if answer.holds else "does not hold"
        print_lines(
            f"the frame of {age:.1f} days ago {verdict}{moved}",
            *answer.why,
            *answer.notes,
        )
    if not answer.holds:
        raise typer.Exit(3)


observe = typer.Typer(
    help="A camera over the dish: tie it to the printer, check it; what it saw of a print.",
    no_args_is_help=True,
)
observe.command("insert")(insert)
observe.command("frame")(frame)
observe.command("check")(check)
observe.command("tip")(tip)
observe.command("sweep")(sweep)
observe.command("looks")(looks)
observe.command("answer")(answer)

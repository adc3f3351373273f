"""`printctl observe tip`: measure the needle tip's offset, width and wear in pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
from numpy.typing import NDArray

from firmware_profiles import Needle, load
from printctl.cli.options import JsonFlag, messages, print_json, print_lines, three_numbers
from printctl.errors import UsageError
from registration.devices.camera_frame import (
    CameraFrame,
    TipView,
    find_tip,
    grounds,
    locate_tip,
    read_frame,
)
from registration.devices.lens.board import decoded
from registration.errors import PictureError

_T95: Final = 1.96
_SURE_MM: Final = 0.02


def tip(
    pictures: Annotated[
        list[Path], typer.Argument(help="Pictures of the needle.", show_default=False)
    ],
    frame: Annotated[
        list[Path], typer.Option("--frame", help="File of `observe frame`; one for all pictures, "
                                 "or one for each (several cameras).")
    ],
    at: Annotated[
        list[str], typer.Option("--at", metavar="X,Y,Z", help="The printer's position in each "
                                "picture, in their order.")
    ],
    needle: Annotated[str, typer.Option("--needle", help="Needle profile.")],
    reach_mm: Annotated[
        float, typer.Option("--reach-mm", help="How far the tip may be off.", min=0.1, max=20)
    ] = 2.0,
    ground: Annotated[
        Path | None, typer.Option("--ground", help="The same scene without the needle (of one "
                                  "camera); other pictures serve as such, if not given.")
    ] = None,
    known_z_mm: Annotated[
        float | None, typer.Option("--known-z-mm", help="Standard uncertainty of Z, where the "
                                   "needle was touched off; one picture will do then.", min=0.001)
    ] = None,
    as_json: JsonFlag = False,
) -> None:  # fmt: skip
    """Find where the needle's tip is: its offset from the printer's position, its width, its wear.

    Take four pictures with the needle at places some 20 mm apart around the dish's middle, well
    above the bath; or two of two cameras.
    """
    if len(at) != len(pictures):
        raise UsageError(f"{len(pictures)} pictures and {len(at)} places; give one --at for each")
    if len(frame) not in (1, len(pictures)):
        raise UsageError(f"{len(frame)} frames; give one, or one for each of {len(pictures)}")
    rod = load(Needle, needle)
    files = {path: read_frame(path) for path in frame}
    frames = [files[path] for path in (frame if len(frame) > 1 else frame * len(pictures))]
    places = np.array([three_numbers(word, "--at") for word in at])
    views, missed = _views(pictures, frames, places, rod, reach_mm, ground)
    for said in missed:
        messages().print(said, markup=False)
    if not views:
        raise PictureError("the tip is not found in any picture")
    first = None if known_z_mm is None else np.array([5.0, 5.0, known_z_mm])
    found = locate_tip(views, rod.outer_mm, u_first_mm=first)
    u_mm, offset = found.u_mm, found.offset_mm
    notes = list(found.worn)
    if u_mm.max() > _SURE_MM:
        axis = "xyz"[int(u_mm.argmax())]
        notes.append(
            f"{axis} is known to {_T95 * 1e3 * u_mm.max():.0f} µm only: give more pictures with "
            "the needle farther apart, or one from another side"
        )
    if as_json:
        print_json({
            "offset_mm": offset.tolist(), "u_mm": u_mm.tolist(), "outer_mm": found.outer_mm,
            "u_outer_mm": found.u_outer_mm, "worn": found.worn, "views": found.views,
            "misfit": found.misfit if np.isfinite(found.misfit) else None,
            "not_found": missed, "notes": notes,
        })  # fmt: skip
        return
    print_lines(
        *(
            f"tip {name}   {o:+.3f} ± {_T95 * u:.3f} mm from the printer's position"
            for name, o, u in zip("xyz", offset, u_mm, strict=True)
        ),
        f"outer   {found.outer_mm:.3f} ± {_T95 * found.u_outer_mm:.3f} mm ({rod.outer_mm:g} by the "
        "profile)",
        f"(95 %, {found.views} of {len(pictures)} pictures)",
        *notes,
    )


def _views(
    pictures: list[Path],
    frames: list[CameraFrame],
    places: NDArray[np.float64],
    rod: Needle,
    reach_mm: float,
    ground: Path | None,
) -> tuple[list[TipView], list[str]]:
    """Pictures in which the tip is found, and what is said of the others."""
    images = [decoded(path) for path in pictures]
    scene = None if ground is None else decoded(ground)
    behind: list[NDArray[Any] | None] = [scene] * len(images)
    if ground is None:
        for one in {id(each): each for each in frames}.values():
            own = [n for n, each in enumerate(frames) if each is one]
            picked = grounds([images[n] for n in own], one, places[own], rod.outer_mm, reach_mm)
            for n, other in zip(own, picked, strict=True):
                behind[n] = other
    views, missed = [], []
    for n, path in enumerate(pictures):
        try:
            seen = find_tip(
                images[n], frames[n], places[n], rod.outer_mm, reach_mm=reach_mm,
                length_mm=rod.length_mm, ground=behind[n], source=str(path),
            )  # fmt: skip
        except PictureError as exc:
            missed.append(f"{path}: not found: {exc}")
            continue
        views.append(TipView(frames[n], seen, places[n]))
    return views, missed

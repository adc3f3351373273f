"""`printctl film`: make a film of a network's growth, or of a pulse (pressure or flow) in it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import typer

from printctl.analysis.film import (
    Frame,
    GrowthFilm,
    PulseFilm,
    check_suffix,
    growth_frames,
    pulse_frames,
    write_film,
)
from printctl.analysis.flow.conditions import recipe_of
from printctl.analysis.networks import Drive, Source, load_source
from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, UnitOption, messages, print_json, print_lines
from printctl.cli.view import FromOption
from printctl.errors import UsageError
from printctl.recipe.growth import Growth
from printctl.settings import arg, opt
from registration.report.picture import FilmScene, PictureOptions, Quantity, quantities

# Typer options of `printctl film`: growth or pulse, steps, solver, colour, size, frame rate.

_OF_GROWTH: Final = ("by", "steps", "unit")
_OF_PULSES: Final = ("solver", "frames", "cycles", "tables")


@command
def film(
    context: typer.Context,
    source: Path = arg(
        "A run folder; of growth also a network (.csv, .vtp, .swc, .json, .npz, .txt)."
    ),
    show: Literal["growth", "pulse"] = opt("How it grew, or a pulse through it.", "growth"),
    out: Path | None = opt(
        "The film: .mp4, .mov, .avi, .gif or .webp; growth.mp4 or pulse.mp4 in the run."
    ),
    by: Literal["terminals", "generations"] = opt(
        "Of growth: one terminal after the other, or joint after joint.", "terminals"
    ),
    steps: int = opt("Frames of growth by terminals.", 60, min=2, max=2000),
    solver: Literal["0d", "1d"] = opt("Of a pulse: lumped, or waves (1d).", "0d"),
    frames: int = opt("Of a cycle.", 50, min=8, max=2000),
    cycles: int = opt("Of a pulse.", 2, min=1, max=100),
    tables: Path = opt("Folder of the recipe's tables (a pulse's, the outlets').", Path()),
    colour: Literal["radius", "kind", "tree", "order", "flow", "pressure"] | None = opt(
        "Of growth any (kind where there are several, else radius); of a pulse pressure or flow.",
        None,
        "--colour",
        "--color",
    ),
    seen_from: FromOption = "oblique",
    width: int = opt("Pixels.", 900, min=300, max=3000),
    fps: float = opt("Frames in 1 s of the film.", 12.0, min=1.0, max=60.0),
    unit: UnitOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Make a film of a network: how it grew, or with --show pulse a pulse through it.

    Frames have a scale bar, axes and a colour bar; a pulse's the inlet's wave, too. Growth is that
    of the finished network: vessels come in the order in which they were grown.
    """
    asked = Asked(show, source, colour, context.params)
    _refuse_idle(context, show)
    path = out or (source if source.is_dir() else source.parent) / f"{show}.mp4"
    check_suffix(path)
    loaded = load_source(source, unit, Drive())
    scene = FilmScene(loaded.network, loaded.surface, PictureOptions(seen_from, width))
    made = _frames(asked, loaded, scene)
    with messages().status("drawing") as status:
        count = write_film(path, _with_progress(made, status.update), fps)
    if as_json:
        print_json({"file": str(path), "frames": count, "seconds": count / fps})
        return
    print_lines(f"{path} ({count} frames, {count / fps:.1f} s)")


@dataclass(frozen=True)
class Asked:
    """What the user asks for; ``options`` are all of them by name."""

    show: str
    source: Path
    colour: str | None
    options: dict[str, Any]


def _frames(asked: Asked, loaded: Source, scene: FilmScene) -> Iterator[Frame]:
    chosen = asked.options
    if asked.show == "growth":
        quantity = _coloured(loaded, asked.colour)
        how = GrowthFilm(chosen["by"], chosen["steps"], murray_exponent=_murray(asked.source))
        return growth_frames(scene, quantity, how)
    if asked.colour not in (None, "pressure", "flow"):
        raise UsageError(f"--colour {asked.colour}: a pulse is shown by pressure or flow")
    if not asked.source.is_dir():
        raise UsageError(f"{asked.source} is no run folder, and a pulse is its recipe's; give one")
    shown: Any = asked.colour or "pressure"
    film_of = PulseFilm(shown, chosen["solver"], chosen["frames"], chosen["cycles"])
    return pulse_frames(scene, recipe_of(asked.source, "a pulse"), chosen["tables"], film_of)


def _coloured(loaded: Source, colour: str | None) -> Quantity:
    """The quantity that was named, or kind where there are several, else radius."""
    known = {each.key: each for each in quantities(loaded.network, loaded.known)}
    several = len(set(loaded.network.kind.tolist())) > 1
    name = colour or ("kind" if several else "radius")
    if name not in known:
        raise UsageError(f"--colour {name}: nothing is known of it; known: {', '.join(known)}")
    return known[name]


def _murray(source: Path) -> float:
    """The exponent that a run was grown with; 3 of anything else."""
    if not source.is_dir():
        return 3.0
    part = recipe_of(source, "a film").vasculature
    return part.murray_exponent if isinstance(part, Growth) else 3.0


def _refuse_idle(context: typer.Context, show: str) -> None:
    """Refuse an option that does nothing for this film."""
    for name in _OF_PULSES if show == "growth" else _OF_GROWTH:
        given = context.get_parameter_source(name)
        if given is not None and given.name == "COMMANDLINE":
            other = "pulse" if show == "growth" else "growth"
            raise UsageError(f"--{name.replace('_', '-')} is for --show {other}; drop it")


def _with_progress(frames: Iterator[Frame], tell: Any) -> Iterator[Frame]:
    for number, frame in enumerate(frames, 1):
        tell(f"frame {number}")
        yield frame

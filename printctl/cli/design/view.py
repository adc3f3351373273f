"""`printctl view`, `film`: show a network or G-code as a page, a picture or a film."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, Literal

import typer

from design.network_files.by_suffix import READ
from printctl.analysis import film as films
from printctl.analysis.flow.conditions import recipe_of
from printctl.analysis.networks import Drive, Source, load_source
from printctl.cli import options as cli
from printctl.cli.declare import json_command, wants_json
from printctl.errors import UsageError
from printctl.pipeline.job import viewing
from printctl.recipe.sections.growth import Growth
from printctl.settings import arg, of, opt
from report.picture import FilmScene, PictureOptions, View, quantities

_FOR_NETWORKS = ("seen_from", *(one.name for one in fields(viewing.NetworkView)))
_FOR_GCODE = tuple(one.name for one in fields(viewing.GcodeView))


@json_command
def view(
    *,
    context: typer.Context,
    source: Path = arg(
        "A run folder, a network (.csv, .vtp, .swc, .json, .npz, .txt), or G-code (.gcode)."
    ),
    out: Path | None = opt("The page; view.html in the run, NAME.view.html beside a file."),
    png: Path | None = opt("Draw a picture for a paper; without --out no page."),
    look: viewing.ViewOptions,
    open_page: bool | None = opt(
        "Open the page in the browser; on a desktop, do.", None, "--open/--no-open"
    ),
    network: viewing.NetworkView,
    gcode: viewing.GcodeView,
) -> None:
    """Show a network or G-code: a page that opens offline, or with --png a picture.

    A network turns, is cut away, and is coloured by any quantity; point at a vessel to read its
    numbers. G-code of any slicer goes by layers, lines to scale; point at one to read its text.
    """
    for option, path, suffixes in (("--out", out, (".html", ".htm")), ("--png", png, (".png",))):
        if path is not None and (path.suffix.lower() not in suffixes or path.is_dir()):
            raise UsageError(f"{option} {path}: give the name of a {suffixes[0]} file")
    if source.is_file() and source.suffix.lower() not in (*READ, *viewing.SUFFIXES):
        raise UsageError(
            f"{source} is neither a network ({', '.join(READ)}) nor G-code "
            f"({', '.join(viewing.SUFFIXES)}) by its name; give one of these, or a run folder"
        )
    idle, kind = _FOR_GCODE, f"G-code ({', '.join(viewing.SUFFIXES)})"
    if viewing.is_gcode(source):
        idle, kind = _FOR_NETWORKS, "a network; this is G-code"
    cli.refuse_typed(context, idle, f"with {source}: it is for {kind}; drop it")
    if out is None and png is None:
        out = source / "view.html" if source.is_dir() else source.with_suffix(".view.html")
    if viewing.is_gcode(source):
        data = cli.read_gcode_file(source)
        written, notes = viewing.view_gcode(source, data, out, png, look, gcode, cli.print_note)
    else:
        written, notes = viewing.view_network(source, out, png, look, network, cli.print_note)
    facts: dict[str, Any] = {"notes": list(notes)}
    lines = []
    for kind, path in written.items():
        size = path.stat().st_size
        facts[kind] = {"file": str(path), "bytes": size}
        shown = f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"
        lines.append(f"{path} ({shown})")
    cli.print_dim(notes)
    cli.print_result(facts, lines)
    wanted = not wants_json() and _on_desktop() if open_page is None else open_page
    if wanted and "page" in written:
        webbrowser.open(written["page"].resolve().as_uri())


def _on_desktop() -> bool:
    """Whether a window would be seen: never from a script, nor over a plain SSH connection."""
    shown = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    return shown and sys.stdout.isatty()


_OF_GROWTH: Final = ("by", "steps", "unit")
_OF_PULSES: Final = ("solver", "frames", "cycles", "tables")


@json_command
def film(
    context: typer.Context,
    source: Path = arg(
        "A run folder; of growth also a network (.csv, .vtp, .swc, .json, .npz, .txt)."
    ),
    show: Literal["growth", "pulse"] = opt(
        "Animation: growth of the network, or a pulse through it.", "growth"
    ),
    out: Path | None = opt(
        "The film: .mp4, .mov, .avi, .gif or .webp; growth.mp4 or pulse.mp4 in the run."
    ),
    by: Literal["terminals", "generations"] = opt(
        "Growth: terminal by terminal, or joint by joint.", "terminals"
    ),
    steps: int = opt("Frames of growth by terminals.", 60, min=2, max=2000),
    solver: Literal["0d", "1d"] = opt("Pulse model: lumped, or waves (1d).", "0d"),
    frames: int = opt("Number of frames per cycle.", 50, min=8, max=2000),
    cycles: int = opt("Number of cycles of a pulse.", 2, min=1, max=100),
    tables: Path = opt("Folder of the recipe's tables (a pulse's, the outlets').", Path()),
    colour: Literal["radius", "kind", "tree", "order", "flow", "pressure"] | None = opt(
        "Colour: for growth any quantity (default: kind if there are several, otherwise radius); "
        "for a pulse pressure or flow.",
        None,
        "--colour",
        "--color",
    ),
    seen_from: View = of(viewing.ViewOptions, "seen_from"),
    width: int = opt("Pixels.", 900, min=300, max=3000),
    fps: float = opt("Frames in 1 s of the film.", 12.0, min=1.0, max=60.0),
    unit: cli.UnitOption = None,
) -> None:
    """Make a film of a network: how it grew, or with --show pulse a pulse through it.

    Frames have a scale bar, axes and a colour bar; a pulse's the inlet's wave, too. Growth is that
    of the finished network: vessels come in the order in which they were grown.
    """
    idle, other = (_OF_PULSES, "pulse") if show == "growth" else (_OF_GROWTH, "growth")
    cli.refuse_typed(context, idle, f"is for --show {other}; drop it")
    path = out or (source if source.is_dir() else source.parent) / f"{show}.mp4"
    films.check_suffix(path)
    loaded = load_source(source, unit, Drive())
    scene = FilmScene(loaded.network, loaded.surface, PictureOptions(seen_from, width))
    made = _frames(context.params, loaded, scene)
    with cli.messages().status("drawing") as status:
        count = films.write_film(path, _with_progress(made, status.update), fps)
    facts = {"file": str(path), "frames": count, "seconds": count / fps}
    cli.print_result(facts, [f"{path} ({count} frames, {count / fps:.1f} s)"])


def _frames(requested: dict[str, Any], loaded: Source, scene: FilmScene) -> Iterator[films.Frame]:
    """Frames of growth or of a pulse, by the options' names."""
    colour, source = requested["colour"], requested["source"]
    if requested["show"] == "growth":
        grown = recipe_of(source, "a film").vasculature if source.is_dir() else None
        murray = grown.murray_exponent if isinstance(grown, Growth) else 3.0
        how = films.GrowthFilm(requested["by"], requested["steps"], murray_exponent=murray)
        known = {each.key: each for each in quantities(loaded.network, loaded.known)}
        several = len(set(loaded.network.kind.tolist())) > 1
        name = colour or ("kind" if several else "radius")
        if name not in known:
            raise UsageError(f"--colour {name}: nothing is known of it; known: {', '.join(known)}")
        return films.growth_frames(scene, known[name], how)
    if colour not in (None, "pressure", "flow"):
        raise UsageError(f"--colour {colour}: a pulse is shown by pressure or flow")
    if not source.is_dir():
        raise UsageError(f"{source} is no run folder, and a pulse is its recipe's; give one")
    film_of = films.PulseFilm(
        colour or "pressure", requested["solver"], requested["frames"], requested["cycles"]
    )
    return films.pulse_frames(scene, recipe_of(source, "a pulse"), requested["tables"], film_of)


def _with_progress(frames: Iterator[films.Frame], tell: Any) -> Iterator[films.Frame]:
    for number, frame in enumerate(frames, 1):
        tell(f"frame {number}")
        yield frame

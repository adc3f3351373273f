"""Boundary conditions, fluid and units of a recipe's flow section, for the solvers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from design.hemodynamics import (
    FlowConditions,
    PulsatileConditions,
    same_shear_conditions,
    scaled_network,
)
from design.network import VesselNetwork
from printctl.analysis.flow.outlets import pulsatile_conditions, steady_conditions
from printctl.errors import UsageError
from printctl.recipe import Recipe
from printctl.recipe.parts import (
    FlowPart,
    LossPart,
)
from printctl.run_folder.artefacts import NETWORK
from printctl.run_folder.manifest import Manifest, digest_file


@dataclass(frozen=True)
class Driven:
    """A flow section, and what its numbers are relative to.

    Attributes
    ----------
    part : FlowPart
    folder : Path
        That its tables' names are relative to.
    print_scale : float
        Of the networks that are solved over the section's design.
    """

    part: FlowPart
    folder: Path = Path()
    print_scale: float = 1.0

    def steady(self, network: VesselNetwork) -> FlowConditions:
        """Conditions of the print's size, at the wall shear of the design's.

        Raises
        ------
        UsageError, OSError
            As `steady_conditions`.
        """
        small = scaled_network(network, 1.0 / self.print_scale)
        made = steady_conditions(self.part, self.folder, small)
        return same_shear_conditions(made, self.print_scale)

    def pulsatile(self, network: VesselNetwork) -> PulsatileConditions | None:
        """The same of the section's pulse; None without one.

        Raises
        ------
        UsageError, FlowInputError, OSError
            As `pulsatile_conditions`.
        """
        return None if self.part.pulse is None else self.problem(network)

    def problem(self, network: VesselNetwork) -> PulsatileConditions:
        """The pulse's conditions, or a constant inlet's, as files of other solvers hold them.

        Raises
        ------
        UsageError, FlowInputError, OSError
            As `pulsatile_conditions`, and for a fluid or losses that these files don't know.
        """
        if self.part.viscosity is not None or self.part.losses != LossPart():
            raise UsageError(
                "files of other solvers hold one viscosity and no losses; leave viscosity and "
                "losses out (--viscosity-mpa-s takes their place), or the file"
            )
        return pulsatile_conditions(
            self.part, self.part.pulse, self.folder, self.print_scale, network
        )


def recipe_of(folder: Path, what: str = "--as-printed") -> Recipe:
    """The recipe of a run, for ``what`` needs it.

    Raises
    ------
    UsageError
        When the folder is no run's.
    """
    if not (folder / NETWORK).is_file():
        raise UsageError(
            f"{what} wants a run folder, and {folder} holds no {NETWORK}; `printctl run` makes one"
        )
    try:
        return Recipe.model_validate(Manifest.load(folder).facts["recipe"])
    except (KeyError, ValidationError) as exc:
        raise UsageError(
            f"the manifest in {folder} has no recipe of this version, which {what} needs; run the "
            f"recipe again, or give {folder / NETWORK} and options"
        ) from exc


def driven_by_run(run: Path, part: FlowPart, print_scale: float) -> Driven:
    """A run's section with the folder of its tables: the one where it was run, or near the run.

    Raises
    ------
    UsageError
        For a table that is in none of them as the run has read it.
    """
    tables = [part.outlets, None if part.pulse is None else part.pulse.table]
    named = [name for name in tables if name is not None and not Path(name).is_absolute()]
    if not named:
        return Driven(part, Path(), print_scale)
    digests = Manifest.load(run).facts.get("inputs", {})
    places = [Path(), *run.resolve().parents[:2]]
    for folder in places:
        files = [(folder / name, digests.get(name)) for name in named]
        if all(file.is_file() and known in (None, digest_file(file)) for file, known in files):
            return Driven(part, folder, print_scale)
    raise UsageError(
        f"{named[0]}, a table of the run's recipe, isn't there as the run has read it (looked in "
        f"{', '.join(map(str, places))}); start the command in the recipe's folder"
    )

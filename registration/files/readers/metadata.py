"""Merge a scan's metadata from file, sidecar and user; orient and check the scan."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, TypeGuard

import numpy as np
import yaml
from pydantic import Field

from firmware_profiles.yaml_file import read_yaml
from registration.errors import ScanFileError
from registration.files.readers.common import Array, FileVolume, native
from registration.files.readers.decibels import (
    COUNT_KEYS,
    in_decibels,
    layered,
    light_notes,
    with_scale,
)
from registration.scan import Scan, Space

ORDER = "zyx"


def to_scan_axes(volume: Array, axes: str, path: Path) -> Array:
    """A view with the axes z, y, x, from a volume whose axes are named slowest to fastest.

    Raises
    ------
    ScanFileError
        When `axes` isn't an order of x, y, z.
    """
    named = axes.lower()
    if not is_axes(axes):
        raise ScanFileError(
            f"{path}: axes are {axes!r}; give an order of x, y and z, slowest first, like zyx for "
            "a stack of depth slices or yxz where depth runs fastest; give --axes"
        )
    return volume.transpose([named.index(name) for name in ORDER])


def rename_axes(sizes: Sequence[float], old: str, new: str) -> list[float]:
    """Sizes along z, y, x of a file's axes that are called otherwise from now on."""
    by_new = {
        after: sizes[ORDER.index(before)]
        for before, after in zip(old.lower(), new.lower(), strict=True)
    }
    return [by_new[name] for name in ORDER]


def is_axes(axes: object) -> bool:
    """Whether something is an order of x, y and z."""
    return isinstance(axes, str) and sorted(axes.lower()) == sorted(ORDER)


def unmirrored(volume: Array) -> Array:
    """The same voxels with y reversed: a left-handed order of axes becomes right-handed."""
    return volume[:, ::-1, :]


def check_aspect(
    shape: Sequence[int], voxel: Sequence[float], extent: Sequence[float], path: Path
) -> None:
    """Hold sizes against the extent that the file gives apart from them; all as z, y, x in mm.

    Raises
    ------
    ScanFileError
        When they contradict each other; the message says if axes were swapped.
    """
    sizes = [count * step for count, step in zip(shape, voxel, strict=True)]
    if _agree(shape, voxel, extent):
        return
    for first, second in ((1, 2), (0, 2), (0, 1)):
        swapped = list(voxel)
        swapped[first], swapped[second] = swapped[second], swapped[first]
        if _agree(shape, swapped, extent):
            raise ScanFileError(
                f"{path}: axes {ORDER[first]} and {ORDER[second]} are swapped: voxels of "
                f"{_mm(voxel)} mm make {_mm(sizes)} mm, but the field is said to be "
                f"{_mm(extent)} mm (z, y, x); export it again, or give --voxel-um"
            )
    raise ScanFileError(
        f"{path}: voxels of {_mm(voxel)} mm make {_mm(sizes)} mm, but the field is said to be "
        f"{_mm(extent)} mm (z, y, x); the header contradicts itself, give --voxel-um"
    )


def _agree(shape: Sequence[int], voxel: Sequence[float], extent: Sequence[float]) -> bool:
    # Some programs count the steps between voxels, others the voxels: one voxel is forgiven.
    return all(
        abs(count * step - size) <= max(0.02 * size, 1.01 * step)
        for count, step, size in zip(shape, voxel, extent, strict=True)
    )


def _mm(values: Sequence[float]) -> str:
    return " × ".join(f"{value:.4g}" for value in values)


SCHEMA = "printctl-scan-1"
_CHOICES = {"scale": ("linear", "db"), "modality": ("oct", "microct", "confocal")}
_LONGEST_VOXEL_MM = 5.0
_SHORTEST_VOXEL_MM = 1e-5
_OPTIONS = {"voxel_mm": "--voxel-um (sidecar: voxel_mm)"}
_MOST_CHECKED_BYTES = 8 << 30


@dataclass(frozen=True)
class ScanOverrides:
    """What the user says of a scan; takes precedence over the file. None: as the file says.

    Attributes
    ----------
    voxel_mm : (dz, dy, dx) or None, mm
        Voxel size; dz optical where `optical_depth`.
    refractive_index : float or None
        Group index.
    optical_depth : bool or None
        Whether dz counts optical path.
    scale : "linear" or "db" or None
        Of the intensity.
    modality : "oct" or "microct" or "confocal" or None
        What measured.
    depth_down : bool or None
        Whether growing depth index goes down into the sample.
    axes : str or None
        Order of the file's axes, slowest first, like "zyx" or "yxz".
    mirrored : bool or None
        Whether x, y, z as named make a left-handed frame; y is then reversed.
    db_range : (low, high) or None, dB
        What the lowest and the highest count mean; of integers those of their type.
    count_range : (first, last) or None
        The counts that mean the ends of `db_range`, where those aren't the type's own.
    counts_per_db, db_at_zero : float or None
        Instead of `db_range`: ``dB = db_at_zero + count / counts_per_db``.
    """

    voxel_mm: tuple[float, float, float] | None = None
    refractive_index: Annotated[float, Field(ge=1, le=2)] | None = None
    optical_depth: bool | None = None
    scale: Literal["linear", "db"] | None = None
    modality: Literal["oct", "microct", "confocal"] | None = None
    depth_down: bool | None = None
    axes: Annotated[str, Field(pattern="^[xyz]{3}$")] | None = None
    mirrored: bool | None = None
    db_range: tuple[float, float] | None = None
    count_range: tuple[float, float] | None = None
    counts_per_db: Annotated[float, Field(gt=0)] | None = None
    db_at_zero: float | None = None


NAMES = tuple(item.name for item in fields(ScanOverrides))
_FRAME = ("axes", "mirrored")
_OF_SCAN = tuple(name for name in NAMES if name not in (*_FRAME, *COUNT_KEYS))


@dataclass(frozen=True)
class _Oriented:
    """A volume in the scan's frame."""

    volume: Array
    handedness: Literal["right", "unknown"]
    space: Space | None
    notes: tuple[str, ...]


def describe(scan: Scan) -> str:
    """The scan's metadata as ASCII JSON, for a file whose axes are z, y, x."""
    return json.dumps(
        {"schema": SCHEMA, "axes": "zyx", **metadata_of(scan)}, sort_keys=True, allow_nan=False
    )


def metadata_of(scan: Scan) -> dict[str, object]:
    """What a scan says of itself, but for the order of its axes in some file."""
    plain: dict[str, object] = {name: getattr(scan, name) for name in _OF_SCAN}
    if scan.scale == "db" and scan.volume.dtype.kind in "ui":
        plain |= {"counts_per_db": 1.0, "db_at_zero": 0.0}
    if scan.handedness == "right":
        plain["mirrored"] = False
    return plain


def parse(text: str, source: str) -> dict[str, object]:
    """Metadata in a JSON text; unknown keys are refused.

    Raises
    ------
    ScanFileError
        When the text isn't a JSON object, or holds a key that isn't known.
    """
    try:
        data = json.loads(text)
    except ValueError as exc:
        raise ScanFileError(f"{source}: not JSON ({exc}); mend or remove it") from exc
    return known_keys(data, source)


def known_keys(data: Any, source: str, more: tuple[str, ...] = ()) -> dict[str, object]:
    """A mapping whose keys are all known, less the name of its schema.

    Raises
    ------
    ScanFileError
        When it is no mapping, or holds a key that isn't known.
    """
    allowed = (*NAMES, *more)
    if not isinstance(data, dict):
        raise ScanFileError(f"{source}: holds no JSON object; give keys {', '.join(allowed)}")
    left = {name: value for name, value in data.items() if name != "schema"}
    unknown = sorted(str(name) for name in set(left) - set(allowed))
    if unknown:
        raise ScanFileError(f"{source}: unknown key {unknown[0]}; known are {', '.join(allowed)}")
    return left


def build_scan(
    file: FileVolume,
    beside: Mapping[str, Any],
    overrides: ScanOverrides,
    path: Path,
    keep_counts: bool = False,
) -> Scan:
    """Check and join what is known of a scan.

    `keep_counts`: leave counts that stand for dB as they are (`Scan.counts`).

    Raises
    ------
    ScanFileError
        When something needed is missing or impossible, naming the option that gives it.
    """
    given = {name: value for name, value in asdict(overrides).items() if value is not None}
    in_file = _redivided(_renamed(file.known, {**beside, **given}), {**beside, **given}, path)
    known = with_scale(layered(in_file, beside, given), path)
    origins = dict.fromkeys(in_file, "file") | dict.fromkeys(beside, "sidecar")
    origins |= dict.fromkeys(given, "option")
    known.setdefault("depth_down", known.get("modality") == "oct" or None)
    if known.get("modality") != "oct":
        # Only light has an optical path of another length, and only stacks of slices are common.
        plain = {"refractive_index": 1.0, "optical_depth": False, "depth_down": False}
        known = {**plain, "axes": "zyx"} | {n: v for n, v in known.items() if v is not None}
    _refuse_missing(known, path, file.notes)
    _check_volume(file.volume, path)
    _check_choices(known, path)
    voxel = _voxel(known["voxel_mm"], path)
    _check_swapped(voxel, in_file.get("voxel_mm"), path)
    turned = _oriented(file, known, voxel, path)
    _check_finite(turned.volume, path)
    light = light_notes(turned.volume, known, "scale" in given, path)
    volume, counts = turned.volume, None
    if known["scale"] == "db":
        volume, counts = in_decibels(volume, known, path, keep_counts)
    return Scan(
        volume=volume,
        counts=counts,
        voxel_mm=voxel,
        refractive_index=_index(known["refractive_index"], path),
        optical_depth=known["optical_depth"],
        scale=known["scale"],
        modality=known["modality"],
        depth_down=known["depth_down"],
        came_from=path,
        handedness=turned.handedness,
        space=turned.space,
        origins={name: origins[name] for name in _OF_SCAN if name in origins},
        notes=(*file.notes, *turned.notes, *light),
    )


def _renamed(in_file: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, object]:
    """What the file says of its axes' sizes, for the names that the user gives the axes."""
    old, new, sizes = in_file.get("axes"), given.get("axes"), in_file.get("voxel_mm")
    if is_axes(old) and is_axes(new) and _are_sizes(sizes):
        return {**in_file, "voxel_mm": rename_axes(sizes, str(old), str(new))}
    return dict(in_file)


def _redivided(
    in_file: Mapping[str, Any], given: Mapping[str, Any], path: Path
) -> Mapping[str, Any]:
    """Depth that the program divided by one index, for the other index that the user says."""
    was, now = in_file.get("refractive_index"), given.get("refractive_index")
    depth_from_file = not ({"voxel_mm", "optical_depth"} & set(given))
    divided = in_file.get("optical_depth") is False and _are_sizes(in_file.get("voxel_mm"))
    if was and now and divided and depth_from_file and in_file.get("modality") == "oct":
        dz, dy, dx = in_file["voxel_mm"]
        return {**in_file, "voxel_mm": (dz * _index(was, path) / _index(now, path), dy, dx)}
    return in_file


def _refuse_missing(known: Mapping[str, Any], path: Path, notes: Sequence[str]) -> None:
    needed = (*_OF_SCAN, "axes")
    missing = [name for name in needed if known.get(name) is None]
    if missing:
        options = ", ".join(_OPTIONS.get(n, "--" + n.replace("_", "-")) for n in missing)
        read = f" ({'; '.join(notes)})" if notes else ""
        raise ScanFileError(
            f"{path}: doesn't say {', '.join(missing)}; give {options}{read}", tuple(missing)
        )


def _oriented(
    file: FileVolume, known: Mapping[str, Any], voxel: tuple[float, float, float], path: Path
) -> _Oriented:
    """The volume as z, y, x of a right-handed frame, where that lies, and what was turned."""
    axes, space, mirrored = known["axes"], file.space, known.get("mirrored")
    volume = to_scan_axes(file.volume, axes, path)
    if space is not None:
        in_file = not space.is_right_handed(axes)
        if mirrored is None:
            mirrored = in_file
        elif mirrored is not in_file:
            space = None  # The user knows better: what the file says of its axes doesn't hold.
    notes = ("its axes are mirrored (left-handed): y was reversed",) if mirrored else ()
    reversed_mm = (volume.shape[1] - 1) * voxel[1] if mirrored else None
    return _Oriented(
        native(unmirrored(volume) if mirrored else volume),
        "unknown" if mirrored is None else "right",
        None if space is None else space.of_scan(axes, reversed_mm),
        notes,
    )


def _check_volume(volume: Array, path: Path) -> None:
    if volume.ndim != 3:
        raise ScanFileError(
            f"{path}: holds an array of shape {volume.shape}, not a stack of grey images; "
            "export one channel and one time point"
        )
    if volume.dtype.kind not in "uif":
        raise ScanFileError(f"{path}: grey values of type {volume.dtype} aren't real numbers")


def _check_finite(volume: Array, path: Path) -> None:
    """Refuse NaN and infinities; a volume too large for memory is probed, not read through."""
    if volume.dtype.kind != "f":
        return
    probe = volume if volume.nbytes <= _MOST_CHECKED_BYTES else volume[::16, ::4, ::4]
    bad = sum(int(part.size - np.count_nonzero(np.isfinite(part))) for part in probe)
    if bad:
        raise ScanFileError(
            f"{path}: {bad} of {probe.size} voxels are NaN or infinite; export it again, with "
            "empty places as 0"
        )


def _check_choices(known: Mapping[str, Any], path: Path) -> None:
    for name, allowed in _CHOICES.items():
        if known[name] not in allowed:
            raise ScanFileError(f"{path}: {name} is {known[name]!r}; known are {allowed}")
    for name in ("optical_depth", "depth_down", "mirrored"):
        if not isinstance(known.get(name, False), bool | None):
            raise ScanFileError(f"{path}: {name} is {known[name]!r}; it must be true or false")
    if not isinstance(known["axes"], str):
        raise ScanFileError(f"{path}: axes is {known['axes']!r}; it must be a text like zyx")


def _voxel(value: Any, path: Path) -> tuple[float, float, float]:
    if not _are_sizes(value):
        raise ScanFileError(
            f"{path}: voxel_mm is {value!r}; it must be three sizes dz, dy, dx in mm of "
            f"{_SHORTEST_VOXEL_MM:g} to {_LONGEST_VOXEL_MM:g}; give {_OPTIONS['voxel_mm']}"
        )
    return (float(value[0]), float(value[1]), float(value[2]))


def _are_sizes(value: Any) -> TypeGuard[Sequence[float]]:
    return (
        isinstance(value, list | tuple)
        and len(value) == 3
        and all(
            isinstance(size, int | float) and _SHORTEST_VOXEL_MM <= size <= _LONGEST_VOXEL_MM
            for size in value
        )
    )


def _check_swapped(voxel: tuple[float, float, float], in_file: Any, path: Path) -> None:
    """Refuse sizes that are those of the file in another order."""
    if not _are_sizes(in_file):
        return
    same = np.allclose(voxel, in_file, rtol=0.01)
    if not same and np.allclose(sorted(voxel), sorted(in_file), rtol=0.01):
        raise ScanFileError(
            f"{path}: its axes and the voxel size that was given are swapped: the file says dz, "
            f"dy, dx = {tuple(in_file)} mm, --voxel-um or the sidecar {voxel} mm; mend their order"
        )


def _index(value: Any, path: Path) -> float:
    if not (isinstance(value, int | float) and 1.0 <= value <= 2.0):
        raise ScanFileError(
            f"{path}: refractive_index is {value!r}; it must lie in 1 to 2 (hydrogels near 1.34); "
            "give --refractive-index"
        )
    return float(value)


RAW_KEYS = ("shape", "dtype", "offset_bytes", "byte_order")
"""What a raw file's sidecar says besides: how its numbers lie."""
_SUFFIXES = (".json", ".yaml", ".yml")


def sidecar(path: Path, more: tuple[str, ...] = ()) -> dict[str, object]:
    """Metadata in a JSON or YAML file of the scan's name, if there is one.

    Raises
    ------
    ScanFileError
        When it can't be parsed, or holds a key that isn't known.
    """
    beside = find_sidecar(path)
    if beside is None:
        return {}
    text = beside.read_text(encoding="utf-8")
    if beside.suffix == ".json" and not more:
        return parse(text, str(beside))
    try:
        # JSON is YAML.
        plain = read_yaml(text)
    except yaml.YAMLError as exc:
        raise ScanFileError(f"{beside}: not YAML ({exc}); mend or remove it") from exc
    return known_keys(plain, str(beside), more)


def find_sidecar(path: Path) -> Path | None:
    """The sidecar file of a scan, or None."""
    for suffix in _SUFFIXES:
        place = path.with_suffix(suffix)
        if place != path and place.is_file():
            return place
    return None

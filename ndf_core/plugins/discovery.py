"""What the installed distributions say they offer. Reads metadata; imports nothing of a plugin."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import Distribution, distributions, version

from ndf_core.errors import RepresentationError
from ndf_core.lines import one_line, plain_line
from ndf_core.names import nearest

GROUP, EXPORTERS, OBSERVERS = "ndf.representations", "ndf.exporters", "ndf.observers"
"""The entry-point groups, also in `ndf_core.api`, which is too slow to import for a listing."""

OWNERS = {
    **dict.fromkeys(("analytic", "mesh", "grid", "neural"), "ndf-plugin-sdf"),
    **dict.fromkeys(("soup", "oriented-points", "points"), "ndf-plugin-pointcloud"),
    "gaussians": "ndf-plugin-gaussians",
    "nerf": "ndf-plugin-nerf",
}
"""Distributions that keep a name when another claims it as well, so that no stranger can disable these."""

BUILT_IN: dict[str, dict[str, str]] = {
    OBSERVERS: {name: f"ndf_core.observers.{name}" for name in ("jsonl", "tensorboard", "wandb")},
    EXPORTERS: dict.fromkeys(("ply", "obj", "stl", "glb", "off"), ""),
}
"""Names that ndf-core itself offers, with their entry modules; the writers of meshes are no plugins."""

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")


@dataclass(frozen=True)
class Entry:
    """One claim to a name."""

    name: str
    target: str
    """Entry-point value: the light module."""
    distribution: str
    version: str
    error: str | None = None
    """Why it cannot be used, as far as metadata tell."""
    group: str = GROUP

    @property
    def origin(self) -> str:
        """Distribution and version, for messages."""
        return f"{self.distribution} {self.version}"


@lru_cache(maxsize=3)
def entries(group: str = GROUP) -> tuple[Entry, ...]:
    """All claims of a group, usable or not, by name and then distribution; read once per process."""
    found = sorted(_claims(group), key=lambda entry: (entry.name, entry.distribution))
    count = Counter(entry.name for entry in found)
    return tuple(_judge(entry, [other for other in found if other.name == entry.name], count) for entry in found)


def claims(name: str) -> list[Entry]:
    """Who claims a name, the usable one first; never empty.

    Raises:
        RepresentationError: nobody does; the message says what to install, or which name was meant.
    """
    found = [entry for entry in entries() if entry.name == name]
    if found:
        return sorted(found, key=lambda entry: entry.error is not None)
    missing = not_installed()
    if name in missing:
        raise RepresentationError(f"--repr {name}: is not installed; pip install {missing[name]}")
    advice = nearest(name, dict.fromkeys([*(entry.name for entry in entries()), *missing]))
    raise RepresentationError(f"--repr {name}: there is no such representation; {advice}")


def not_installed() -> dict[str, str]:
    """Representations of ndf's own plugins that nobody offers here, and the distributions that would."""
    offered = {entry.name for entry in entries()}
    return {name: owner for name, owner in OWNERS.items() if name not in offered}


def _judge(entry: Entry, same_name: list[Entry], count: Counter[str]) -> Entry:
    if entry.error:
        return entry
    if not _NAME.fullmatch(entry.name):
        return replace(entry, error="its name must be lower-case letters, digits and hyphens")
    own = BUILT_IN.get(entry.group, {}).get(entry.name)
    if own is not None and entry.target != own:
        return replace(entry, error="ndf-core itself offers this name, and keeps it; rename this one")
    owner = OWNERS.get(entry.name) if entry.group == GROUP else "ndf-core"
    owned = [other for other in same_name if _canonical(other.distribution) == owner]
    if count[entry.name] == 1 or owned == [entry]:
        return entry
    if owned:
        return replace(entry, error=f"the name clashes with {owned[0].origin}, which keeps it; rename this one")
    others = ", ".join(other.origin for other in same_name if other is not entry)
    return replace(entry, error=f"the name clashes with {others}; uninstall one of them")


def _claims(group: str) -> Iterator[Entry]:
    for name, target in BUILT_IN.get(group, {}).items():
        if target:
            yield Entry(name, target, "ndf-core", version("ndf-core"), group=group)
    seen: set[str] = set()
    for distribution in distributions():
        try:
            text = distribution.read_text("entry_points.txt") or ""
        except (OSError, UnicodeDecodeError):
            continue  # metadata that pip cannot read either; nothing says that it is a plugin
        if group not in text:
            continue
        name, number = _identity(distribution)
        if _canonical(name) in seen:  # the first on the path hides the others, as for imports
            continue
        seen.add(_canonical(name))
        try:
            points = [point for point in distribution.entry_points if point.group == group]
        except Exception as error:
            cause = f"entry_points.txt cannot be read: {one_line(error)}"
            yield Entry(name, "", name, number, cause, group)
            continue
        for point in points:
            yield Entry(plain_line(point.name), plain_line(point.value), name, number, group=group)


def _identity(distribution: Distribution) -> tuple[str, str]:
    """Name and version; placeholders where the METADATA file lacks them or cannot be read."""
    try:
        metadata = distribution.metadata.json
    except Exception:
        metadata = {}
    return plain_line(str(metadata.get("name") or "unnamed")), plain_line(str(metadata.get("version") or "0"))


def _canonical(name: str) -> str:
    """PEP 503."""
    return re.sub(r"[-_.]+", "-", name).lower()

"""All that a plugin imports to register what it offers: `hookimpl`, `API_VERSION`, and a spec.

`RepresentationSpec` (with `Sniff`) for inputs of `ndf fit`, `ExporterSpec` for output formats of `ndf extract`,
`ObserverSpec` for what follows a fit.

A plugin's entry module must import fast, since `ndf` imports it to look at files and to print help: pydantic and the
standard library, never numpy or torch. What is heavy belongs in the module that `RepresentationSpec.open` names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pluggy
from pydantic import BaseModel

PROJECT = "ndf"
"""pluggy project name."""
ENTRY_POINT_GROUP = "ndf.representations"
"""Entry-point group; the entry point's name is the `--repr` value, its value the light module."""
EXPORTER_GROUP = "ndf.exporters"
"""Entry-point group of output formats; the entry point's name is the file name's ending without its dot."""
OBSERVER_GROUP = "ndf.observers"
"""Entry-point group of observers; the entry point's name is the one that ``ndf fit --observe`` takes."""
API_VERSION = 1
"""Version of this module's contract. A plugin writes the number that it was made for, never this constant."""

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@dataclass(frozen=True)
class Sniff:
    """What a plugin thinks of a file after a short look at its content."""

    confidence: float
    """In (0, 1]: 1 the content can be nothing else; 0.6 the content fits; 0.3 only the suffix fits. The single
    highest answer wins, and two equal highest ones are an error that names both, so keep to these three."""
    reason: str
    """One line for the user: "closed triangle mesh", say."""


@dataclass(frozen=True)
class RepresentationSpec:
    """One `--repr` value: what it is called, how it is configured, and where the code that opens it lives."""

    name: str
    """The `--repr` value; equal to the entry point's name."""
    summary: str
    """One line for listings and help."""
    config: type[BaseModel]
    """Options of this representation: a pydantic model, frozen, extra forbidden, every field described."""
    open: str
    """``"package.module:function"``, imported only when a run starts.
    ``function(source: str | Path | object, config) -> ndf_core.interfaces.Surface`` with an instance of `config`."""
    api_version: int
    """The `API_VERSION` that the plugin was made for."""
    support: Literal["full", "partial"]
    """"full": as accurate as the representation itself; "partial": the paper's limits apply (Table 1)."""
    training_defaults: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Fit options that suit this representation, nested as in `FitConfig` (Table 3 weights)."""
    suffixes: tuple[str, ...] = ()
    """File name endings that it reads, lower case with the dot; only for messages, `sniff` decides."""
    sniff: Callable[[Path], Sniff | None] | None = None
    """Cheap look at the content (some kilobytes, no numpy); None where the source is not this representation's.
    Also called with sources that are no files, such as ``module:callable``, as a `Path` of that text."""


@dataclass(frozen=True)
class ExporterSpec:
    """One output format of `ndf extract`. The formats that ndf writes itself (.ply, .obj, ...) cannot be replaced."""

    name: str
    """The file name's ending without its dot, lower case; equal to the entry point's name."""
    summary: str
    """One line for listings."""
    write: str
    """``"package.module:function"``, imported when a file is written.
    ``function(file: BinaryIO, mesh: ndf_core.extract.extracted.ExtractedMesh, colors) -> None``, with an array of
    uint8 (v, 3) or None as colours; what it raises leaves no file behind."""
    api_version: int
    """The `API_VERSION` that the plugin was made for."""


@dataclass(frozen=True)
class ObserverSpec:
    """What can follow a fit: ``ndf fit --observe NAME`` or ``--observe NAME:TARGET``."""

    name: str
    """Equal to the entry point's name."""
    summary: str
    """One line for listings; says what TARGET is."""
    open: str
    """``"package.module:function"``, imported when a fit starts.
    ``function(target: str | None) -> ndf_core.fitting.observer.Observer``; ``target`` is what follows the colon."""
    api_version: int
    """The `API_VERSION` that the plugin was made for."""


@hookspec(firstresult=True)
def ndf_representation() -> RepresentationSpec:  # pyright: ignore[reportReturnType]  # a hook spec has no body
    """Return the representation that this entry module offers; called once, right after import."""


@hookspec(firstresult=True)
def ndf_exporter() -> ExporterSpec:  # pyright: ignore[reportReturnType]  # a hook spec has no body
    """Return the output format that this entry module offers; called once, right after import."""


@hookspec(firstresult=True)
def ndf_observer() -> ObserverSpec:  # pyright: ignore[reportReturnType]  # a hook spec has no body
    """Return the observer that this entry module offers; called once, right after import."""

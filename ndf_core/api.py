"""All that a plugin imports to register a representation: `hookimpl`, `RepresentationSpec`, `Sniff`, `API_VERSION`.

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


@hookspec(firstresult=True)
def ndf_representation() -> RepresentationSpec:  # pyright: ignore[reportReturnType]  # a hook spec has no body
    """Return the representation that this entry module offers; called once, right after import."""

"""Open a source as a `Surface` with the function that its plugin names; heavy imports happen here."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from ndf_core.api import RepresentationSpec
from ndf_core.errors import InputError, NdfError, PluginError
from ndf_core.lines import one_line
from ndf_core.plugins.discovery import entries
from ndf_core.plugins.guard import ForeignFailure, guarded
from ndf_core.plugins.source import check_source

if TYPE_CHECKING:  # interfaces imports torch, which `ndf plugins --check` must survive without
    from ndf_core.interfaces import ColoredPoints, Surface


def opener(spec: RepresentationSpec) -> Any:
    """The function that `spec.open` names.

    Raises:
        PluginError: its module cannot be imported or has no such function.
    """
    module, _, name = spec.open.partition(":")
    try:
        found: Any = guarded(lambda: import_module(module), f"importing {module}", seconds=None)
        for part in name.split("."):
            found = getattr(found, part)
    except (ForeignFailure, AttributeError) as error:
        raise PluginError(f"--repr {spec.name}: the plugin cannot be used: {error}") from error
    if not callable(found):
        raise PluginError(f"--repr {spec.name}: the plugin cannot be used: {spec.open} is not callable")
    return found


def open_surface(spec: RepresentationSpec, source: str | Path | object, config: BaseModel) -> Surface:
    """The surface in `source`, read as `spec` says.

    Raises:
        InputError: the source cannot be read as this representation.
        PluginError: the plugin cannot be imported, or failed with an error that is not an `NdfError`.
    """
    check_source(source)
    function = opener(spec)
    shown = source if isinstance(source, (str, Path)) else type(source).__name__
    try:
        surface = function(source, config)
    except NdfError:
        raise
    except OSError as error:
        raise InputError(f"{shown}: cannot be read: {error.strerror or error}") from error
    except MemoryError as error:
        raise InputError(f"{shown}: too large for this machine's memory") from error
    except (Exception, SystemExit) as error:
        raise PluginError(f"--repr {spec.name}: the plugin failed on {shown}: {one_line(error)}") from error
    checked = _checked(surface, spec)
    return checked if checked.colors else replace(checked, colors=lambda: _file_colors(source))


def _file_colors(source: str | Path | object) -> ColoredPoints | None:
    """The colours at the vertices of a file, for representations that say nothing of their own."""
    from ndf_core.interfaces import ColoredPoints
    from ndf_core.readers.colors import read_vertex_colors

    found = read_vertex_colors(source)
    return None if found is None else ColoredPoints(*found)


def _checked(surface: object, spec: RepresentationSpec) -> Surface:
    from ndf_core.interfaces import Surface

    if not isinstance(surface, Surface):
        raise PluginError(f"--repr {spec.name}: {spec.open} returned {type(surface).__name__}, not a Surface")
    if surface.representation != spec.name:
        raise PluginError(f"--repr {spec.name}: the surface says that it is {surface.representation!r}")
    origin = next((entry.origin for entry in entries() if entry.name == spec.name and entry.error is None), "")
    return replace(surface, plugin=origin, training_defaults=surface.training_defaults or spec.training_defaults)

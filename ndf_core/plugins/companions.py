"""Plugins beside representations: exporters (output formats) and observers (what follows a fit)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ndf_core import api
from ndf_core.errors import ConfigError, NdfError, OutputError, PluginError
from ndf_core.files import atomic_write
from ndf_core.lines import one_line
from ndf_core.names import nearest
from ndf_core.plugins.contract import target_fault, version_fault
from ndf_core.plugins.discovery import EXPORTERS, OBSERVERS, Entry, entries
from ndf_core.plugins.guard import SECONDS, ForeignFailure, guarded
from ndf_core.plugins.loading import ask_for

if TYPE_CHECKING:
    from numpy import ndarray as Array

    from ndf_core.extract.extracted import ExtractedMesh
    from ndf_core.fitting.observer import Observer


class _Kind(NamedTuple):
    what: str
    hook: str
    spec: type[api.ExporterSpec] | type[api.ObserverSpec]
    function: str
    """Field of the spec that names what does the work."""


_KINDS = {
    EXPORTERS: _Kind("exporter", "ndf_exporter", api.ExporterSpec, "write"),
    OBSERVERS: _Kind("observer", "ndf_observer", api.ObserverSpec, "open"),
}


def exporter_suffixes() -> tuple[str, ...]:
    """File name endings that plugins write, with the dot; from metadata alone."""
    return tuple(f".{entry.name}" for entry in entries(EXPORTERS) if entry.error is None)


def export(path: Path, mesh: ExtractedMesh, colors: Array | None = None) -> None:
    """Write a mesh with the plugin that the file's suffix names; other processes see the whole new file or none.

    Args:
        path: its suffix names the format.
        mesh: what to write.
        colors: red, green and blue of each vertex, uint8, where the asset has colours.

    Raises:
        PluginError: its plugin cannot be used.
        OutputError: it failed while it wrote, or the file cannot be written.
    """
    entry = _claim(EXPORTERS, path.suffix.lower().removeprefix("."))
    write = companion(entry)
    with atomic_write(path) as file:
        try:
            guarded(lambda: write(file, mesh, colors), f"writing with {entry.origin}", seconds=None)
        except ForeignFailure as failure:
            raise OutputError(f"cannot write {path}: {failure}") from failure


def open_observers(wanted: Sequence[str]) -> list[Observer]:
    """Observers from ``NAME`` or ``NAME:TARGET`` each, every one in a thread of its own.

    Raises:
        ConfigError: there is none of this name.
        NdfError: it refuses its target, or its plugin cannot be used.
    """
    return [_observer(*text.partition(":")[::2]) for text in wanted]


def _observer(name: str, target: str) -> Observer:
    entry = _claim(OBSERVERS, name)
    open_it = companion(entry)
    from ndf_core.fitting.observer_thread import InThread

    try:
        return InThread(name, lambda: open_it(target or None))
    except NdfError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(f"observer {name}: the plugin {entry.origin} failed: {one_line(error)}") from error


def companion(entry: Entry, seconds: float = SECONDS) -> Callable[..., Any]:
    """The function behind an exporter or observer, with its plugin imported and checked.

    Raises:
        PluginError: it cannot be used; the message says which distribution and why, in one line.
    """
    kind = _KINDS[entry.group]
    try:
        if entry.error is not None:
            raise ForeignFailure(entry.error)
        spec: Any = guarded(lambda: ask_for(entry, kind.hook, kind.spec), f"importing {entry.target}", seconds)
        target = getattr(spec, kind.function)
        fault = version_fault(spec.api_version) or target_fault(target, kind.function)
        if spec.name != entry.name:
            fault = fault or f"the entry point is called {entry.name!r} but the {kind.what} {spec.name!r}"
        if fault:
            raise ForeignFailure(fault)
        return guarded(lambda: _function(target), f"importing {target}", seconds=None)
    except ForeignFailure as failure:
        where = f"{kind.what} {entry.name}: the plugin {entry.origin}"
        raise PluginError(f"{where} cannot be used: {failure}") from failure


def _function(target: str) -> Callable[..., Any]:
    module, _, name = target.partition(":")
    found: Any = import_module(module)
    for part in name.split("."):
        found = getattr(found, part)
    if not callable(found):
        raise TypeError(f"{target} is not callable")
    return found


def _claim(group: str, name: str) -> Entry:
    """Who offers a name, the usable one first."""
    found = sorted(
        (entry for entry in entries(group) if entry.name == name), key=lambda entry: entry.error is not None
    )
    if found:
        return found[0]
    names = dict.fromkeys(entry.name for entry in entries(group))
    raise ConfigError(f"there is no {_KINDS[group].what} {name!r}; {nearest(name, names)}")

"""Import one plugin's entry module, ask for its `RepresentationSpec`, and check that it keeps the contract."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from importlib.metadata import EntryPoint
from typing import Any, TypeVar

import pluggy

from ndf_core import api
from ndf_core.errors import PluginError
from ndf_core.plugins.checking import probe
from ndf_core.plugins.contract import RULES
from ndf_core.plugins.discovery import OWNERS, Entry, claims, entries
from ndf_core.plugins.guard import SECONDS, ForeignFailure, guarded

T = TypeVar("T")


def load(name: str) -> api.RepresentationSpec:
    """The spec of the representation called `name`.

    Raises:
        RepresentationError: no plugin claims the name.
        PluginError: its plugin cannot be used.
    """
    return load_entry(claims(name)[0])


def load_entry(entry: Entry, seconds: float = SECONDS) -> api.RepresentationSpec:
    """The checked spec of one claim.

    Raises:
        PluginError: it cannot be used; the message says which distribution and why, in one line.
    """
    cause = entry.error
    if cause is None:
        try:
            spec, cause = guarded(lambda: _examine(entry), f"importing {entry.target}", seconds)
            if cause is None:
                return spec
        except ForeignFailure as failure:
            cause = str(failure)
    raise PluginError(f"--repr {entry.name}: the plugin {entry.origin} cannot be used: {cause}")


@lru_cache(maxsize=1)
def load_usable() -> tuple[list[api.RepresentationSpec], list[str]]:
    """All specs that can be had, and one line for each that cannot; tried once per process.

    Nobody asked for these plugins, so one of a stranger, which could end the interpreter, is first imported in a
    process of its own.
    """
    specs: list[api.RepresentationSpec] = []
    broken: list[str] = []
    strangers = [entry for entry in entries() if entry.distribution not in OWNERS.values()]
    causes = dict(zip(strangers, probe(strangers, "light", SECONDS, at_once=8), strict=True))
    for entry in entries():
        try:
            specs.append(load_entry(replace(entry, error=causes.get(entry, entry.error))))
        except PluginError as error:
            broken.append(str(error))
    return specs, broken


def ask(entry: Entry) -> api.RepresentationSpec:
    """Import the entry module and call its hook, unguarded; whether the spec keeps the contract is not looked at.

    Raises:
        TypeError: the module has no such hook, or its answer is no `RepresentationSpec`.
    """
    return ask_for(entry, "ndf_representation", api.RepresentationSpec)


def ask_for(entry: Entry, hook: str, kind: type[T]) -> T:
    """The same for any hook and its spec.

    One pluggy manager per plugin, so that none can see or shadow another's hook.
    """
    manager = pluggy.PluginManager(api.PROJECT)
    manager.add_hookspecs(api)
    manager.register(EntryPoint(entry.name, entry.target, entry.group).load())
    manager.check_pending()
    caller: Any = getattr(manager.hook, hook)
    if not caller.get_hookimpls():
        raise TypeError(f"it has no @hookimpl function {hook}")
    spec: Any = caller()
    if not isinstance(spec, kind):
        article = "an" if kind.__name__[0] in "EO" else "a"
        raise TypeError(f"{hook}() returned {type(spec).__name__}, not {article} {kind.__name__}")
    return spec


def _examine(entry: Entry) -> tuple[api.RepresentationSpec, str | None]:
    spec = ask(entry)
    return spec, next((fault for rule in RULES if (fault := rule(spec, entry.name))), None)

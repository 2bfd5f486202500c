"""The conformance kit on one plugin, in a process of its own: for ``ndf plugins --check NAME SOURCE``."""

from __future__ import annotations

import json
from importlib.util import find_spec
from typing import Any

from ndf_core.errors import PluginError
from ndf_core.plugins.child import run_child
from ndf_core.plugins.discovery import claims
from ndf_core.plugins.source import check_source

CONFORMANCE_SECONDS = 600.0
"""For all checks together: each opens and cuts the source anew."""


def check_conformance(name: str, source: str | None, seconds: float = CONFORMANCE_SECONDS) -> list[dict[str, Any]]:
    """What each check of `ndf_core.testing` finds, as mappings with `check`, `status`, `reason`, `message`.

    Args:
        name: of the representation.
        source: a file that it reads; None checks what needs none.
        seconds: after which the whole is given up.

    Raises:
        InputError: there is no such source.
        RepresentationError: no plugin claims the name.
        PluginError: the checks did not come to an end.
    """
    (entry, *_) = claims(name)
    if source is not None:
        check_source(source)
    if find_spec("torch") is None:
        raise PluginError(f"--repr {name}: checking its laws needs torch: pip install 'ndf-core[fit]'")
    where = f"--repr {name}: checking {entry.origin}"
    done = run_child("ndf_core.testing.probe", [name, *([] if source is None else [source])], seconds)
    if done.status is None:
        raise PluginError(f"{where} did not finish within {seconds:g} s; give a smaller source")
    try:
        return json.loads(done.output)
    except ValueError:
        raise PluginError(f"{where} ended the interpreter {done.cause}") from None

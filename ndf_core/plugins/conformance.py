"""The conformance kit on one plugin, in a process of its own: for ``ndf plugins --check NAME SOURCE``."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

from ndf_core.errors import PluginError
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
    command = [sys.executable, "-P", "-m", "ndf_core.testing.probe"]
    asked = json.dumps({"name": name, "source": source})
    try:
        done = subprocess.run(command, input=asked, capture_output=True, text=True, timeout=seconds)
    except subprocess.TimeoutExpired:
        message = f"--repr {name}: checking {entry.origin} did not finish within {seconds:g} s; give a smaller source"
        raise PluginError(message) from None
    try:
        return json.loads(done.stdout)
    except ValueError:
        last = done.stderr.strip().rpartition("\n")[2]
        message = f"--repr {name}: checking {entry.origin} ended the interpreter (exit status {done.returncode})"
        raise PluginError(f"{message}: {last}" if last else message) from None

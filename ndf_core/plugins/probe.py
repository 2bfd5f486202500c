"""The process behind `checking`: ``... GROUP NAME DISTRIBUTION light|all SECONDS`` prints JSON."""

from __future__ import annotations

import json
import os
import sys

from ndf_core.errors import PluginError
from ndf_core.plugins.companions import companion
from ndf_core.plugins.discovery import GROUP, entries
from ndf_core.plugins.guard import SECONDS
from ndf_core.plugins.loading import load_entry
from ndf_core.plugins.opening import opener


def main(group: str, name: str, distribution: str, what: str, seconds: str) -> None:
    """Load the plugin and import what does its work. What foreign code prints, in any way, goes to stderr.

    `seconds` bounds the import of the light entry module, where it is less than what a run allows.
    """
    answer = os.dup(1)
    os.dup2(2, 1)
    entry = next(entry for entry in entries(group) if (entry.name, entry.distribution) == (name, distribution))
    limit = min(float(seconds), SECONDS)
    cause = None
    try:
        if group == GROUP:
            spec = load_entry(entry, limit)
            if what == "all":
                opener(spec)
        else:
            companion(entry, limit)
    except PluginError as error:
        cause = str(error).partition("cannot be used: ")[2]
    os.write(answer, json.dumps({"cause": cause}).encode())
    os._exit(0)  # a thread that hangs, or an atexit of foreign code, must not hold the answer back


if __name__ == "__main__":
    main(*sys.argv[1:])

"""The process behind `checking`: ``python -m ndf_core.plugins.probe GROUP NAME DISTRIBUTION SECONDS`` prints JSON."""

from __future__ import annotations

import json
import os
import sys

from ndf_core.errors import PluginError
from ndf_core.plugins.companions import companion
from ndf_core.plugins.discovery import GROUP, entries
from ndf_core.plugins.loading import load_entry
from ndf_core.plugins.opening import opener


def main(group: str, name: str, distribution: str, seconds: float) -> None:
    """Load the plugin and import what does its work. What foreign code prints, in any way, goes to stderr."""
    answer = os.dup(1)
    os.dup2(2, 1)
    entry = next(entry for entry in entries(group) if (entry.name, entry.distribution) == (name, distribution))
    cause = None
    try:
        if group == GROUP:
            opener(load_entry(entry, seconds))
        else:
            companion(entry, seconds)
    except PluginError as error:
        cause = str(error).partition("cannot be used: ")[2]
    os.write(answer, json.dumps({"cause": cause}).encode())
    os._exit(0)  # a thread that hangs, or an atexit of foreign code, must not hold the answer back


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3], float(sys.argv[4]))

"""The `ndf` command. Everything is imported when it is needed: `ndf --help` has to be instant."""

from __future__ import annotations

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 done, 2 the command line or a config is wrong, 3 the input,
    an asset or a plugin is bad, 130 interrupted, 1 a fault of ndf itself."""
    from ndf_core.cli.guard import run

    return run(sys.argv[1:] if arguments is None else list(arguments))

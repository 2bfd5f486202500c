"""The process behind `ndf_core.plugins.conformance`: ``... NAME [SOURCE]`` prints what the checks find as JSON."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from ndf_core.testing.run import run_checks
from ndf_core.testing.subject import Subject


def main(name: str, source: str | None = None) -> None:
    """Run all checks. What foreign code prints goes to stderr."""
    answer = os.dup(1)
    os.dup2(2, 1)
    with tempfile.TemporaryDirectory() as folder:
        outcomes = run_checks(Subject(name, source, Path(folder)))
    os.write(answer, json.dumps([asdict(outcome) for outcome in outcomes]).encode())
    os._exit(0)  # a thread that hangs, or an atexit of foreign code, must not hold the answer back


if __name__ == "__main__":
    main(*sys.argv[1:])

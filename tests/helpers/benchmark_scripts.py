"""The scripts in `benchmarks/` as modules; they are no package."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType

_FOLDER = str(Path(__file__).resolve().parents[2] / "benchmarks")


def script(name: str) -> ModuleType:
    """Import ``benchmarks/<name>.py``; scripts find their neighbours as when they are run."""
    sys.path.insert(0, _FOLDER)
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(_FOLDER)

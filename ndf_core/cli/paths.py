"""Is the output writable? Asked before the work starts, not when an hour of it is lost."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from ndf_core.errors import OutputError


def check_output(path: Path, suffixes: Iterable[str], source: Path | None = None) -> None:
    """Refuse an output that could not be written.

    Raises:
        OutputError: its suffix is not one of `suffixes` (lower case), its folder does not exist or takes no files,
            something that is no file lies in its place, or it is `source`, the input.
    """
    known = tuple(suffixes)
    if path.suffix.lower() not in known:
        raise OutputError(f"{path}: the output must end in {' '.join(known)}")
    folder = path.parent
    try:
        if path.is_dir():
            raise OutputError(f"{path}: there is a folder of this name; give the output another one")
        if path.exists() and not path.is_file():
            raise OutputError(f"{path}: there is something of this name that is no regular file")
        if not folder.is_dir():
            raise OutputError(f"{path}: there is no folder {folder}; create it first")
        if source is not None and path.exists() and source.exists() and path.samefile(source):
            raise OutputError(f"{path}: the output would replace the input; give it another name")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: the folder {folder} is not writable")

"""What can be said of a source before any plugin sees it."""

from __future__ import annotations

import re
from pathlib import Path

from ndf_core.errors import InputError

_CALLABLE = re.compile(r"(?:[A-Za-z_][\w.]*|.+\.py):[A-Za-z_][\w.]*")


def check_source(source: object) -> None:
    """Refuse what no plugin could read: files must exist and hold bytes.

    Python objects pass, and so do ``module:callable`` and ``file.py:callable``.

    Raises:
        InputError: there is no such file, it may not be read, it is empty, or a pipe or device.
    """
    if not isinstance(source, (str, Path)):
        return
    path = Path(source)
    try:
        found = path.stat()
        if not (path.is_file() or path.is_dir()):
            raise InputError(f"{source}: is no regular file")  # a pipe or a device could keep a reader for ever
        if path.is_file():
            with path.open("rb"):
                pass
    except FileNotFoundError as error:
        if isinstance(source, str) and _CALLABLE.fullmatch(source):
            return
        raise InputError(f"{source}: there is no such file") from error
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        raise InputError(f"{source}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if path.is_file() and found.st_size == 0:
        raise InputError(f"{source}: the file is empty")

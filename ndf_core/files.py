"""Writing files so that a failed or killed process leaves nothing half-written."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Generator
from pathlib import Path
from typing import BinaryIO

from ndf_core.errors import OutputError


@contextlib.contextmanager
def atomic_write(path: Path | str) -> Generator[BinaryIO]:
    """Yield a binary file that becomes `path` when the block ends without an exception, and vanishes otherwise.

    Other processes see the old file or the whole new one, never a part. Where the platform has unnamed files
    (O_TMPFILE), a process killed while it writes leaves nothing at all behind; elsewhere it may leave a temporary
    file in the same folder, never a broken `path`. The content is on the disk before the name is.

    Raises:
        OutputError: the folder does not exist or cannot be written to, or `path` is a folder.
    """
    path = Path(path)
    if os.path.isdir(path):
        raise OutputError(f"cannot write {path}: it is a folder; give a file name")
    if not os.path.isdir(path.parent):
        raise OutputError(f"cannot write {path}: there is no folder {path.parent}; create it first")
    unnamed = _open_unnamed(path.parent)
    if unnamed is None:
        with _named(path) as file:
            yield file
        return
    with os.fdopen(unnamed, "w+b") as file:
        yield file
        _flush(file)
        _name(file, path)


def _open_unnamed(folder: Path) -> int | None:
    """File without a name in `folder`; None where the platform or the file system has no such thing."""
    flag = getattr(os, "O_TMPFILE", None)
    if flag is None:
        return None
    try:
        return os.open(folder, flag | os.O_RDWR, 0o666)
    except OSError:
        return None  # if the folder cannot be written to, opening a named file will say so


def _name(file: BinaryIO, path: Path) -> None:
    """Give an unnamed file the name `path`. Linking cannot replace an existing file; renaming can."""
    try:
        _link(file, path)
        return
    except FileExistsError:
        pass
    except OSError:  # no /proc, or a sandbox that forbids it
        file.seek(0)
        with _named(path) as copy:
            shutil.copyfileobj(file, copy, 1 << 20)
        return
    temporary = _temporary_name(path)
    _link(file, temporary)
    _replace(temporary, path)


def _link(file: BinaryIO, path: Path) -> None:
    # Naming a directory descriptor, though the path is absolute, makes CPython call linkat with AT_SYMLINK_FOLLOW.
    descriptor = file.fileno()
    os.link(f"/proc/self/fd/{descriptor}", path, src_dir_fd=descriptor, follow_symlinks=True)


@contextlib.contextmanager
def _named(path: Path) -> Generator[BinaryIO]:
    temporary = _temporary_name(path)
    try:
        file = temporary.open("xb")
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}") from error
    try:
        with file:
            yield file
            _flush(file)
        _replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _temporary_name(path: Path) -> Path:
    # Independent of the name, which may already be as long as the file system allows.
    return path.parent / f".ndf-{secrets.token_hex(8)}.tmp"


def _flush(file: BinaryIO) -> None:
    file.flush()
    os.fsync(file.fileno())


def _replace(temporary: Path, path: Path) -> None:
    try:
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise OutputError(f"cannot write {path}: {error.strerror}") from error

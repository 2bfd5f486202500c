"""Files that are not what they were said to be."""

from __future__ import annotations

from pathlib import Path

from ndf_core.errors import InputError, NdfError, PluginError
from ndf_core.testing.check import Broken, NotAsked, expect, law
from ndf_core.testing.checks.opening import noise_bytes, source_can_be_opened
from ndf_core.testing.subject import Subject


@law(source_can_be_opened)
def noise_is_refused_by_name(subject: Subject) -> None:
    """A file that cannot be read is the user's to find: the message names it."""
    path = _beside(subject, "noise", noise_bytes())
    try:
        subject.opened(path)
    except InputError as error:
        expect(path.name in str(error), f"the error does not name the file: {error}")
    except Exception as error:
        raise Broken(f"noise must be an InputError, not {type(error).__name__}: {error}") from error
    else:
        raise Broken("noise is read as a surface")


@law(source_can_be_opened)
def half_a_file_does_no_harm(subject: Subject) -> None:
    """Downloads break off; some formats can be read as far as they go, for others it is an error."""
    if subject.path is None or not subject.path.is_file():
        raise NotAsked("the source is no file")
    content = subject.path.read_bytes()
    path = _beside(subject, "half", content[: len(content) // 2])
    try:
        subject.opened(path)
    except PluginError as error:
        raise Broken(str(error)) from error
    except NdfError as error:
        expect(path.name in str(error), f"the error does not name the file: {error}")


def _beside(subject: Subject, stem: str, content: bytes) -> Path:
    """A file with the suffix of the source."""
    if subject.path is None or not subject.path.is_file():
        raise NotAsked("the source is no file")
    path = subject.folder / f"{stem}{''.join(subject.path.suffixes[-2:])}"
    path.write_bytes(content)
    return path

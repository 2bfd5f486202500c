"""Virtual environments that hold what a distribution declares to need, and nothing else."""

from __future__ import annotations

import importlib.metadata as metadata
import venv
from collections.abc import Iterable
from pathlib import Path

from packaging.requirements import Requirement


def requirements(name: str, extras: Iterable[str] = ("",)) -> set[tuple[str, frozenset[str]]]:
    """Distributions that one declares to need, those of its extras included, each with the extras asked of it."""
    found = [Requirement(line) for line in metadata.requires(name) or []]
    wanted = [
        need
        for need in found
        if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in {"", *extras})
    ]
    return {(need.name, frozenset(need.extras)) for need in wanted}


def closure(needs: set[tuple[str, frozenset[str]]]) -> set[str]:
    """Names of them and of all that they need in turn."""
    done: set[tuple[str, frozenset[str]]] = set()
    while left := needs - done:
        done |= left
        needs = done.union(*(requirements(*need) for need in left))
    return {name for name, _ in done}


def make_environment(folder: Path, names: Iterable[str]) -> Path:
    """The folder of executables of a new environment.

    Its packages are links to those installed here, since torch alone takes minutes to install. Of ndf itself there is
    nothing: that comes from wheels.
    """
    venv.create(folder)
    links = folder / "dependencies"
    links.mkdir()
    for name in names:
        distribution = metadata.distribution(name)
        for top in {file.parts[0] for file in distribution.files or []} - {"..", "__pycache__"}:
            target = Path(str(distribution.locate_file(top)))
            if target.exists() and not (links / top).exists():
                (links / top).symlink_to(target)
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "dependencies.pth").write_text(f"{links}\n")
    return folder / "bin"

"""Makers of third-party plugins: real distributions with metadata on a path of their own."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from ndf_core.plugins.discovery import entries
from ndf_core.plugins.loading import load_usable

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCES = ("ndf_core", "pyproject.toml", "setup.py", "README.md", "LICENSE")
"""What a wheel of ndf-core is built from."""

GOOD = """
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from ndf_core.api import RepresentationSpec, Sniff, hookimpl


class Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    resolution: int = Field(default=64, ge=2, le=1024, description="grid points per side")
    corner: tuple[float, float, float] | None = Field(default=None, description="lowest corner of the grid")
    steps: int = Field(default=7, gt=0, description="Newton steps")
    closed: bool = Field(default=True, description="whether the surface is closed")


def sniff(path: Path) -> Sniff | None:
    text = path.read_text(errors="replace") if path.is_file() else ""
    return Sniff(CONFIDENCE, "starts with the word NAME") if text.startswith("NAME") else None


@hookimpl
def ndf_representation() -> RepresentationSpec:
    return RepresentationSpec(
        name="NAME",
        summary="A made-up representation.",
        config=Config,
        open="MODULE_open:open_it",
        api_version=1,
        support="full",
        training_defaults={"loss": {"cycle": 1e5}},
        suffixes=(".blob",),
        sniff=sniff,
    )
"""

OPEN = """
from pathlib import Path

from ndf_core.errors import InputError
from ndf_core.interfaces import BaseMeshExtractor, Projector, Surface


class Nothing(BaseMeshExtractor):
    def extract(self, max_faces, seed=0):
        raise AssertionError("nothing of this toy is run")


class Identity(Projector):
    def project(self, points, directions=None):
        raise AssertionError("nothing of this toy is run")


def open_it(source, config):
    print("opening on stdout")
    text = Path(source).read_text()
    if "bad" in text:
        raise InputError(f"{source}: is bad")
    if "crash" in text:
        raise ZeroDivisionError("of a sloppy author")
    if "exit" in text:
        raise SystemExit(0)
    return Surface("NAME", Nothing(), Identity(), f"{text.strip()} {config.resolution}", notes=("a note",))
"""


@dataclass
class PluginMaker:
    """Writes distributions into `folder`, as pip would lay them out."""

    folder: Path
    modules: list[str] = field(default_factory=list)

    def add(
        self,
        name: str,
        *,
        distribution: str | None = None,
        version: str = "1.0",
        source: str | None = None,
        replace: dict[str, str] | None = None,
        confidence: float = 1.0,
    ) -> str:
        """A distribution that offers the representation `name`; `source` or `replace` break it. Its module's name."""
        distribution = distribution or f"third-party-{name}"
        module = distribution.replace("-", "_")
        text = GOOD if source is None else source
        for old, new in (replace or {}).items():
            assert old in text, old
            text = text.replace(old, new)
        fill = {"NAME": name, "MODULE": module, "CONFIDENCE": str(confidence)}
        opening = OPEN
        for old, new in fill.items():
            text, opening = text.replace(old, new), opening.replace(old, new)
        (self.folder / f"{module}.py").write_text(text)
        (self.folder / f"{module}_open.py").write_text(opening)
        info = self.folder / f"{module}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: {version}\n")
        (info / "entry_points.txt").write_text(f"[ndf.representations]\n{name} = {module}\n")
        self.modules += [module, f"{module}_open"]
        return module

    def forget(self) -> None:
        """Make this process look again."""
        entries.cache_clear()
        load_usable.cache_clear()
        for module in self.modules:
            sys.modules.pop(module, None)


@pytest.fixture
def plugin_maker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[PluginMaker]:
    """A maker whose distributions this process and its children see."""
    folder = tmp_path / "site"
    folder.mkdir()
    maker = PluginMaker(folder)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", str(folder))
    maker.forget()
    yield maker
    maker.forget()


@pytest.fixture(scope="session")
def core_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built once for all of pytest's processes."""
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    out = shared / "wheel"
    with (shared / "wheel.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not any(out.glob("*.whl")):
            _build_wheel(shared / "source", out)
    (built,) = out.glob("*.whl")
    return built


def _build_wheel(copy: Path, out: Path) -> None:
    """From a copy, so that no build product lands in the repository or comes from it."""
    products = shutil.ignore_patterns("*.so", "__pycache__")
    copy.mkdir()
    for name in SOURCES:
        source = REPOSITORY / name
        if source.is_dir():
            shutil.copytree(source, copy / name, ignore=products)
        else:
            shutil.copy(source, copy / name)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    done = subprocess.run([*command, "-w", str(out), str(copy)], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr

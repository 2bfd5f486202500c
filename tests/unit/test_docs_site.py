"""The docs say what the program does: generated pages are up to date, and nothing is left out."""

from __future__ import annotations

import importlib.util
import inspect
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from ndf_core import api, errors, interfaces
from ndf_core.config.fields import leaves
from ndf_core.config.fit import FitConfig
from ndf_core.plugins.discovery import BUILT_IN, OBSERVERS, OWNERS
from ndf_core.plugins.loading import load
from ndf_core.testing.checks import CHECKS

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = REPOSITORY / "docs"


def read(page: str) -> str:
    return (DOCS / page).read_text("utf-8")


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_reference", REPOSITORY / "tools" / "docs_reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", ["cli.md", "config.md", "laws.md"])
def test_pages_made_from_the_program_are_up_to_date(reference: ModuleType, page: str) -> None:
    assert read(f"reference/{page}") == reference.pages()[page], "run: python tools/docs_reference.py"


@pytest.mark.parametrize("name", ["the fit", *OWNERS])
def test_every_option_is_documented(name: str) -> None:
    text = read("reference/config.md")
    for key, leaf in leaves(FitConfig if name == "the fit" else load(name).config).items():
        assert leaf.info.description, key
        assert f"| `{key}` |" in text, key


def test_every_hook_and_every_name_of_the_contract_is_documented() -> None:
    page = read("reference/hooks.md")
    hooks = [name for name, value in vars(api).items() if hasattr(value, f"{api.PROJECT}_spec")]
    assert sorted(hooks) == ["ndf_exporter", "ndf_observer", "ndf_representation"]
    own = [name for name, value in vars(api).items() if getattr(value, "__module__", "") == api.__name__]
    assert set(own) >= {*hooks, "RepresentationSpec"}
    for name in own:
        assert name in page, name
    for module in (api, interfaces, errors):
        assert f"::: {module.__name__}" in page
        for name, value in vars(module).items():
            if getattr(value, "__module__", "") == module.__name__:
                assert inspect.getdoc(value), name


def test_every_law_observer_and_representation_is_documented() -> None:
    laws, observers = read("reference/laws.md"), read("extend.md")
    assert all(f"| `{check.name}` | {check.reason} |" in laws for check in CHECKS)
    assert all(f"| `{name}` |" in observers for name in BUILT_IN[OBSERVERS])
    for name in OWNERS:
        assert f"`--repr {name}`" in read(f"howto/{name}.md")
        assert (DOCS / "pictures" / f"{name}.png").stat().st_size > 20_000, f"python tools/docs_pictures.py {name}"


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_has_every_page(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    menu = (REPOSITORY / "mkdocs.yml").read_text()
    for page in DOCS.rglob("*.md"):
        assert f": {page.relative_to(DOCS).as_posix()}\n" in menu, page
    assert "<math" in (tmp_path / "concepts" / "index.html").read_text()
    assert "RepresentationSpec" in (tmp_path / "reference" / "hooks" / "index.html").read_text()
    assert len(list((tmp_path / "benchmarks").glob("*/index.html"))) > 10

"""Every block of the docs that can run is run, as its reader would, with fits of a few steps."""

from __future__ import annotations

import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from markdown_blocks import blocks_of

from ndf_core.asset.dense_map import dense_map
from ndf_core.base_mesh.level_set import LevelSetExtractor, LevelSetPolicy
from ndf_core.cli import main
from ndf_core.config import resolve
from ndf_core.config.layers import Layer
from ndf_core.fitting import pipeline, quantise, registration, shared_base
from ndf_core.fitting.measure import measure

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = [("index.md", "extend.md"), ("versions.md",), *((f"howto/{path.name}",) for path in DOCS.glob("howto/*.md"))]

pytestmark = pytest.mark.slow


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short trainings, coarse grids and few samples: the words of the docs are the subject, not the result."""
    short = {"steps": 3, "batch": 128, "coverage_every": 0, "faces": 300, "feature_dim": 4}
    monkeypatch.setattr(resolve, "recipe_layer", lambda _name: Layer("recipe of this test", short))
    monkeypatch.setattr(pipeline, "measure", partial(measure, samples=2000))
    monkeypatch.setattr(dense_map, "__defaults__", (10_000,))
    monkeypatch.setattr(quantise, "_SAMPLES", 2000)
    monkeypatch.setattr(shared_base, "TARGET_FACES", 2000)
    monkeypatch.setattr(shared_base.SphereMap, "steps", 3)
    monkeypatch.setattr(registration, "_STEPS", 10)
    monkeypatch.setattr(registration, "_ROUNDS", 1)
    monkeypatch.setattr(quantise, "_PROBE_SAMPLES", 500)
    make = LevelSetExtractor.__init__

    def coarse(self: LevelSetExtractor, *words: Any, policy: LevelSetPolicy | None = None, **more: Any) -> None:
        make(self, *words, policy=replace(policy or LevelSetPolicy(), resolution=64), **more)

    monkeypatch.setattr(LevelSetExtractor, "__init__", coarse)


@pytest.mark.usefixtures("_quick")
@pytest.mark.parametrize("pages", PAGES, ids=lambda pages: pages[0])
def test_the_blocks_of_a_page_run_one_after_another(
    pages: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = 0
    for page in pages:
        for block in blocks_of(DOCS / page):
            if block.title:
                path = tmp_path / block.title
                path.parent.mkdir(exist_ok=True)
                path.write_text(block.text)
            if block.language == "python":
                namespace: dict[str, Any] = {"__name__": block.title or page}
                exec(compile(block.text, block.title or page, "exec"), namespace)
            elif block.language == "bash":
                for line in block.text.splitlines():
                    program, *words = shlex.split(line)
                    assert program == "ndf", line
                    assert main(words) == 0, f"{page}: {line}\n{capfd.readouterr().err}"
            ran += block.language in ("python", "bash")
    assert ran

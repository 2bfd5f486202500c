"""Shapes are checked at run time here: the annotations of the plugin are tests too."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from jaxtyping import install_import_hook

install_import_hook("ndf_plugin_sdf", "beartype.beartype")
sys.path.insert(0, str(Path(__file__).parent / "helpers"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real meshes beside the repository. Of our own, since these tests also run alone, next to wheels."""
    folder = Path(__file__).resolve().parents[4] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("needs the folder of real files, ../shared/data, beside the checkout; its 100 MB are not in it")
    return folder


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)

"""For the tests of every distribution: run-time checks of array shapes, and the data beside the repository."""

from __future__ import annotations

from pathlib import Path

import pytest
from jaxtyping import install_import_hook

# Shapes and dtypes of every annotated array are checked in all that computes. `kernels` checks its arguments itself,
# which its tests test. The light modules (cli, config, plugins) hold no arrays and name heavy types under
# TYPE_CHECKING, which beartype cannot resolve.
CHECKED = [
    "asset",
    "base_mesh",
    "extract",
    "fitting",
    "interfaces",
    "mesh",
    "meshio",
    "processing",
    "readers",
    "render",
    "surfaces",
]

install_import_hook([f"ndf_core.{name}" for name in CHECKED], "shape_checks.check")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real files; skips where there is none."""
    folder = Path(__file__).resolve().parent.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("needs the folder of real files, ../shared/data, beside the checkout; its 100 MB are not in it")
    return folder

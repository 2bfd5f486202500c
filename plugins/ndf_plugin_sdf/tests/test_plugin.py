"""How ndf finds this plugin, and that looking at it stays cheap."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh
from ndf_plugin_sdf import analytic, grid, mesh, neural
from sdf_trees import BALL

import ndf_core
from ndf_core.api import RepresentationSpec
from ndf_core.errors import ConfigError, InputError

HEAVY = ("torch", "numpy", "scipy", "trimesh", "igl", "h5py", "nibabel", "safetensors")


@pytest.mark.parametrize("module", ["analytic", "mesh", "neural", "grid"])
def test_entry_modules_import_nothing_heavy(module: str) -> None:
    code = (
        f"import sys, ndf_plugin_sdf.{module} as m; m.ndf_representation()\n"
        f"print([x for x in {HEAVY} if x in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_sniffing_imports_numpy_at_most(tmp_path: Path) -> None:
    """And that only for triangles, whose closing up has to be looked at."""
    trimesh.creation.torus(2.0, 0.5).export(tmp_path / "a.obj")
    (tmp_path / "a.toml").write_text('type = "sphere"\nradius = 1\n')
    table, triangles = str(tmp_path / "a.toml"), str(tmp_path / "a.obj")
    code = (
        "import sys; from pathlib import Path; from ndf_plugin_sdf import analytic, mesh\n"
        f"heavy = lambda: [x for x in {HEAVY} if x in sys.modules]\n"
        f"print(analytic.sniff(Path({table!r})).confidence, analytic.sniff(Path('a.b:c')).confidence)\n"
        f"print(mesh.sniff(Path({table!r})), heavy())\n"
        f"print(mesh.sniff(Path({triangles!r})).confidence, heavy())"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found == "1.0 0.6\nNone []\n0.6 ['numpy']\n"


def test_open_meshes_are_left_to_others(tmp_path: Path) -> None:
    ring = trimesh.creation.torus(2.0, 0.5)
    ring.update_faces(range(1, len(ring.faces)))
    ring.export(tmp_path / "open.stl")
    found = mesh.sniff(tmp_path / "open.stl")
    assert found is not None
    assert (found.confidence, found.reason) == (0.3, "triangle mesh (STL), not closed")


@pytest.mark.parametrize(
    "spec", [module.ndf_representation() for module in (analytic, mesh, neural, grid)], ids=lambda spec: spec.name
)
def test_specs_keep_the_contract(spec: RepresentationSpec) -> None:
    assert spec.api_version == 1
    assert spec.support == "full"
    assert spec.training_defaults["loss"] == {"cycle": 1e2, "projection": 1e4}
    assert spec.config.model_config["frozen"]
    assert spec.config.model_config["extra"] == "forbid"
    assert all(field.description for field in spec.config.model_fields.values())
    json.dumps(spec.config.model_json_schema())
    spec.config()


def test_the_core_opens_both(tmp_path: Path) -> None:
    trimesh.creation.torus(2.0, 0.5).export(tmp_path / "ring.obj")
    ring = ndf_core.open(tmp_path / "ring.obj", resolution=64)
    assert ring.representation == "mesh"
    assert any("triangle mesh" in note for note in ring.notes)
    assert ring.training_defaults["loss"]["projection"] == 1e4
    (tmp_path / "ball.json").write_text(json.dumps(BALL))
    assert ndf_core.open(tmp_path / "ball.json").representation == "analytic"


def test_three_wrong_values_come_in_one_error(tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text('type = "box"\nsize = [1.0, -2.0, "x"]\ncentre = [0, 0, 0]\n')
    with pytest.raises(InputError) as caught:
        ndf_core.open(path)
    message = str(caught.value)
    for words in (
        "shape.size[1]: must be at least",
        "shape.size[2]: must be a number",
        "shape.centre: is not a field",
    ):
        assert words in message
    with pytest.raises(ConfigError, match="resolution"):
        ndf_core.open(path, resolution=-1)

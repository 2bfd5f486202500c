"""How ndf finds this plugin, and that looking at it stays cheap."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from ndf_plugin_gaussians import gaussians
from splat_writers import compressed, inria, random_splats, sog_files, splat, spz, write_folder, zipped

import ndf_core

HEAVY = ("torch", "numpy", "scipy", "PIL", "zstandard")
SPLATS = random_splats(40)


def test_the_entry_module_imports_nothing_heavy(tmp_path: Path) -> None:
    (tmp_path / "a.spz").write_bytes(spz(SPLATS, 3))
    code = (
        "import sys; from pathlib import Path; from ndf_plugin_gaussians import gaussians as m\n"
        f"m.ndf_representation(); print(m.sniff(Path({str(tmp_path / 'a.spz')!r})).confidence,"
        f" [x for x in {HEAVY} if x in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found == "1.0 []\n"


def test_the_spec_keeps_the_contract() -> None:
    spec = gaussians.ndf_representation()
    assert (spec.name, spec.api_version, spec.support) == ("gaussians", 1, "partial")
    assert spec.training_defaults["loss"] == {"cycle": 1e5, "projection": 1e4}
    assert spec.config.model_config["frozen"]
    assert spec.config.model_config["extra"] == "forbid"
    assert all(field.description for field in spec.config.model_fields.values())
    json.dumps(spec.config.model_json_schema())
    spec.config()


def test_a_crop_box_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="crop: x0, y0, z0 must be below"):
        gaussians.GaussiansConfig(crop=(0, 0, 0, 1, 1, 0))


def test_formats_are_recognised_by_content(tmp_path: Path) -> None:
    contents = {
        "inria": inria(SPLATS, degree=3),
        "compressed": compressed(SPLATS, False),
        "spz gzip": spz(SPLATS, 2),
        "spz zstd": spz(SPLATS, 4),
        "sog": zipped(sog_files(SPLATS)),
    }
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
        found = gaussians.sniff(tmp_path / name)
        assert found is not None, name
        assert found.confidence == 1.0
    folder = write_folder(sog_files(SPLATS), tmp_path / "set")
    assert gaussians.sniff(folder) is not None
    (tmp_path / "a.splat").write_bytes(splat(SPLATS))
    assert gaussians.sniff(tmp_path / "a.splat") == gaussians.Sniff(0.6, "Gaussian splats (.splat)")


def test_other_files_are_left_to_others(tmp_path: Path) -> None:
    columns = "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "mesh.ply").write_text(f"ply\nformat ascii 1.0\nelement vertex 1\n{columns}end_header\n0 0 0\n")
    (tmp_path / "array.npz").write_bytes(zipped({"0000.dense.A.npy": b"x"}))
    (tmp_path / "text.txt").write_text("hello")
    (tmp_path / "folder").mkdir()
    for name in ("mesh.ply", "array.npz", "text.txt", "folder", "absent"):
        assert gaussians.sniff(tmp_path / name) is None, name
    (tmp_path / "broken.spz").write_bytes(b"hello")
    found = gaussians.sniff(tmp_path / "broken.spz")
    assert found is not None
    assert found.confidence == 0.3


def test_real_files_are_taken_for_splats(splat_data: Path) -> None:
    from ndf_core.plugins.choosing import choose

    for path in splat_data.iterdir():
        assert choose(path).spec.name == "gaussians", path.name


def test_the_core_opens_it(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(inria(random_splats(800)))
    surface = ndf_core.open(tmp_path / "a.ply", resolution=32)
    assert surface.representation == "gaussians"
    assert surface.training_defaults["loss"]["cycle"] == 1e3
    paper = ndf_core.open(tmp_path / "a.ply", resolution=32, projection="centre")
    assert paper.training_defaults == gaussians.ndf_representation().training_defaults
    assert any("3DGS .ply" in note for note in surface.notes)

"""The plugin as ndf sees it: recognition, options, all kinds of sources, and one whole fit."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from ndf_plugin_nerf import nerf
from nerf_shapes import THRESHOLD, ball, random_network, shell, solid

import ndf_core
from ndf_core.errors import ConfigError, InputError
from ndf_core.mesh import topology

HEAVY = ("torch", "numpy", "scipy")
BOX = ((-1.5, -1.5, -1.5), (1.5, 1.5, 1.5))


def grid_of(distance, count: int = 49) -> np.ndarray:
    side = np.linspace(-1.5, 1.5, count)
    points = np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1).reshape(-1, 3)
    return solid(distance)(points).reshape(count, count, count).astype(np.float32)


def test_the_spec_keeps_the_contract() -> None:
    spec = nerf.ndf_representation()
    assert (spec.name, spec.support, spec.api_version) == ("nerf", "partial", 1)
    assert spec.training_defaults["loss"] == {"cycle": 1e4, "projection": 1e4}  # Table 3
    assert all(field.description for field in spec.config.model_fields.values())
    json.dumps(spec.config.model_json_schema())
    spec.config()


def test_looking_imports_nothing_heavy_and_claims_only_nerfs(tmp_path: Path) -> None:
    np.savez(tmp_path / "network.npz", **random_network("nerf-pytorch", 0))
    np.savez(tmp_path / "grid.npz", density=grid_of(ball(), 8), bounds=np.array(BOX))
    np.savez(tmp_path / "volume.npz", values=grid_of(ball(), 8))
    np.savez(tmp_path / "implicit.npz", **{"0000.dense.A": np.zeros((3, 8)), "0000.dense.b": np.zeros(8)})
    np.save(tmp_path / "volume.npy", grid_of(ball(), 8))
    weights = {name: torch.from_numpy(array) for name, array in random_network("FlexibleNeRFModel", 0).items()}
    torch.save({"model_fine_state_dict": weights}, tmp_path / "new.ckpt")
    torch.save({"model_fine_state_dict": weights}, tmp_path / "old.ckpt", _use_new_zipfile_serialization=False)
    torch.save({"layers.0.weight": torch.zeros(3, 3)}, tmp_path / "other.pt")
    (tmp_path / "text.ckpt").write_text("layers_xyz.0.weight fc_alpha.weight layer1.weight")
    code = (
        "import sys; from pathlib import Path; from ndf_plugin_nerf import nerf; nerf.ndf_representation()\n"
        f"print([p.name for p in sorted(Path({str(tmp_path)!r}).iterdir()) if nerf.sniff(p)])\n"
        f"print([x for x in {HEAVY} if x in sys.modules], nerf.sniff(Path('some.module:function')))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out == "['grid.npz', 'network.npz', 'new.ckpt', 'old.ckpt']\n[] None\n"
    assert ndf_core.open(tmp_path / "grid.npz", resolution=16).representation == "nerf"


def test_real_files_are_recognised(shared_data: Path) -> None:
    for path in sorted((shared_data / "nerf").iterdir()):
        found = nerf.sniff(path)
        assert (found is not None) == (path.suffix in (".npz", ".ckpt")), path.name
        if found is not None:
            assert (found.confidence, found.reason) == (1.0, "density network of a NeRF (FlexibleNeRFModel)")
    others = [path for folder in ("neural", "grid", "splat", "mesh") for path in (shared_data / folder).iterdir()]
    assert [path.name for path in others if nerf.sniff(path)] == []


def test_a_grid_needs_bounds(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", grid_of(ball()))
    with pytest.raises(InputError, match="--bounds"):
        ndf_core.open(tmp_path / "a.npy", repr="nerf")
    surface = ndf_core.open(tmp_path / "a.npy", repr="nerf", bounds=BOX, threshold=THRESHOLD, resolution=48)
    axis = torch.eye(3, dtype=torch.float64)
    np.testing.assert_allclose(surface.projector.project(0.95 * axis, axis).points.numpy(), np.eye(3), atol=2e-3)
    with pytest.raises(InputError, match="three axes"):
        np.save(tmp_path / "flat.npy", np.zeros((4, 4)))
        ndf_core.open(tmp_path / "flat.npy", repr="nerf", bounds=BOX)


def test_functions(tmp_path: Path) -> None:
    (tmp_path / "hollow.py").write_text(
        "import numpy as np\n"
        "def density(points):\n"
        "    r = np.linalg.norm(points, axis=1)\n"
        "    return np.where((r < 1) & (r > 0.6), 50.0, 0.0)\n"
        "density.bounds = [[-2, -2, -2], [2, 2, 2]]\n"
        "def broken(points):\n"
        "    return points\n"
    )
    surface = ndf_core.open(f"{tmp_path / 'hollow.py'}:density", repr="nerf", resolution=64)
    mesh = surface.base_mesh.extract(300)
    assert topology(mesh.faces, len(mesh.vertices)).components == 1
    assert abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() < 0.1
    with pytest.raises(InputError, match=r"must return 3 densities for points \(3, 3\)"):
        ndf_core.open(f"{tmp_path / 'hollow.py'}:broken", repr="nerf", bounds=BOX)
    with pytest.raises(InputError, match="give the box to look in"):
        ndf_core.open(solid(ball()), repr="nerf")
    with pytest.raises(InputError, match="has no function 'missing'"):
        ndf_core.open(f"{tmp_path / 'hollow.py'}:missing", repr="nerf", bounds=BOX)


def test_wrong_boxes_are_configuration_errors(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", grid_of(ball(), 8))
    for options in ({"crop": (1, 0, 0, 0, 1, 1)}, {"bounds": (BOX[1], BOX[0])}, {"threshold": -1.0}):
        with pytest.raises(ConfigError, match=next(iter(options))):
            ndf_core.open(tmp_path / "a.npy", repr="nerf", **options)


def test_the_fingerprint_follows_content_and_options(tmp_path: Path) -> None:
    options = {"repr": "nerf", "bounds": BOX, "resolution": 16}
    for name, radius in (("a", 1.0), ("b", 1.0), ("c", 0.9)):
        np.save(tmp_path / f"{name}.npy", grid_of(ball(radius=radius), 17))
    a, b, c = (ndf_core.open(tmp_path / f"{name}.npy", **options).fingerprint for name in "abc")
    assert a == b
    assert len({a, c, ndf_core.open(tmp_path / "a.npy", **{**options, "reach": 0.2}).fingerprint}) == 3


@pytest.mark.slow
def test_a_fit_of_a_hollow_ball_is_its_outer_sphere(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", sigma=grid_of(shell(0.6, 1.0), 65), aabb=np.array(BOX).ravel())
    surface = ndf_core.open(tmp_path / "a.npz", threshold=THRESHOLD, resolution=64)
    asset = ndf_core.fit(surface, faces=200, steps=200, threads=1)
    mesh = asset.extract(0.05)
    radius = np.linalg.norm(mesh.vertices, axis=1)
    assert abs(radius - 1).max() < 0.02
    assert abs(radius - 1).mean() < 2e-3


@pytest.mark.slow
def test_real_networks(shared_data: Path) -> None:
    checkpoint, arrays = (
        ndf_core.open(shared_data / "nerf" / name, resolution=64)
        for name in ("krrish_lego.ckpt", "krrish_lego_fine.npz")
    )
    points = torch.rand(200, 3, dtype=torch.float64) * 2 - 1
    directions = torch.nn.functional.normalize(torch.randn(200, 3, dtype=torch.float64), dim=1)
    one, other = (surface.projector.project(points, directions) for surface in (checkpoint, arrays))
    torch.testing.assert_close(one.points, other.points, rtol=0, atol=0)  # the same network twice
    hotdog = ndf_core.open(shared_data / "nerf" / "krrish_hotdog.ckpt", resolution=64)
    assert any("background" in note for note in hotdog.notes)
    with pytest.raises(InputError, match="forward-facing"):
        ndf_core.open(shared_data / "nerf" / "krrish_fern.ckpt")

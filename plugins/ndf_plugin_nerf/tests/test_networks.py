"""The density network that is built from a file's arrays against the authors' own forward pass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from ndf_plugin_nerf.checkpoint import read_checkpoint
from ndf_plugin_nerf.density_network import assemble
from ndf_plugin_nerf.families import networks
from ndf_plugin_nerf.nerf import NerfConfig
from ndf_plugin_nerf.source import read_density
from nerf_shapes import random_network, reference_density

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box

FAMILIES = ("FlexibleNeRFModel", "nerf-pytorch", "nerf_pl")
UNIT = Box(np.full(3, -1.5), np.full(3, 1.5))


@pytest.mark.parametrize("family", FAMILIES)
def test_each_family_gives_its_authors_density(family: str) -> None:
    arrays = random_network(family, seed=1)
    (named,) = networks(arrays)
    assert named.family.name == family
    network = assemble(arrays, named, UNIT)
    points = np.random.default_rng(2).uniform(-1.5, 1.5, (300, 3))
    found = network.on_arrays(points)
    expected = reference_density(family, arrays, points)
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(found, expected, atol=2e-5)
    assert sum(layer.skip for layer in network.layers) == 1


def test_rows_do_not_depend_on_their_batch() -> None:
    arrays = random_network("nerf-pytorch", seed=3)
    network = assemble(arrays, networks(arrays)[0], UNIT)
    points = torch.rand(5000, 3, dtype=torch.float64)
    whole = network.values(points)
    torch.testing.assert_close(whole[4321:4324], network.values(points[4321:4324]), rtol=0, atol=1e-6)


@pytest.mark.parametrize("as_zip", [True, False], ids=["zip", "legacy"])
@pytest.mark.parametrize(
    "names", [("model_coarse_state_dict", "model_fine_state_dict"), ("network_fn", "network_fine")]
)
def test_the_fine_network_is_taken(tmp_path: Path, names: tuple[str, str], as_zip: bool) -> None:
    coarse, fine = (random_network("FlexibleNeRFModel", seed) for seed in (4, 5))
    content = {
        name: {key: torch.from_numpy(value) for key, value in arrays.items()}
        for name, arrays in zip(names, (coarse, fine), strict=True)
    }
    torch.save(content | {"iter": 7}, tmp_path / "a.ckpt", _use_new_zipfile_serialization=as_zip)
    read = read_density(tmp_path / "a.ckpt", NerfConfig())
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    np.testing.assert_allclose(
        read.density.on_arrays(points), reference_density("FlexibleNeRFModel", fine, points), atol=2e-5
    )
    assert any("not used: " + names[0] in note for note in read.notes)
    other = read_density(tmp_path / "a.ckpt", NerfConfig(prefix=names[0]))
    np.testing.assert_allclose(
        other.density.on_arrays(points), reference_density("FlexibleNeRFModel", coarse, points), atol=2e-5
    )


def test_a_checkpoint_with_code_is_refused_and_not_run(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return exec, (f"open({str(tmp_path / 'ran')!r}, 'w')",)

    torch.save({"weights": torch.zeros(3), "trap": Trap()}, tmp_path / "bad.ckpt")
    with pytest.raises(InputError, match=r"code of a file is never run.*state_dict"):
        read_checkpoint(tmp_path / "bad.ckpt")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layers_xyz.2.weight": None, "layers_xyz.2.bias": None}, "some are missing"),
        ({"layer1.weight": np.zeros((8, 20), np.float32)}, "no point"),
        ({"layers_xyz.1.weight": np.zeros((8, 9), np.float32)}, "takes 9 numbers, not 8"),
        ({"layers_xyz.1.weight": np.full((8, 8), np.nan, np.float32)}, "not finite"),
        ({"layers_xyz.1.bias": np.zeros(7, np.float32)}, "no layer"),
        ({"layer1.weight": np.zeros(8, np.float32)}, "no layer"),
    ],
)
def test_arrays_that_fit_no_network_are_refused(change: dict[str, np.ndarray | None], message: str) -> None:
    changed = random_network("FlexibleNeRFModel", seed=6) | change
    arrays = {name: array for name, array in changed.items() if array is not None}
    with pytest.raises(InputError, match=message):
        assemble(arrays, networks(arrays)[0], UNIT)


def test_several_networks_need_a_prefix(tmp_path: Path) -> None:
    both = {
        f"{prefix}.{name}": array
        for prefix in ("left", "right")
        for name, array in random_network("nerf_pl", seed=8).items()
    }
    np.savez(tmp_path / "two.npz", **both)
    with pytest.raises(InputError, match=r"more than one.*'left\.', 'right\.'.*--prefix"):
        read_density(tmp_path / "two.npz", NerfConfig())
    assert "network left" in read_density(tmp_path / "two.npz", NerfConfig(prefix="left")).notes[0]

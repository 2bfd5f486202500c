"""Opening networks: files of every format, descriptions, sides, boxes; real ones; what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch
from ndf_plugin_sdf.neural import NeuralConfig, sniff
from ndf_plugin_sdf.neural_surface import open_neural
from networks import Ball, NeusSdf
from safetensors.torch import save_file

import ndf_core
from ndf_core.base_mesh.checks import check_base_mesh
from ndf_core.errors import InputError


def ball_arrays() -> dict[str, np.ndarray]:
    return {name: tensor.numpy() for name, tensor in Ball().state_dict().items()}


def write_ball(path: Path) -> Path:
    """The ball in the format that the suffix names."""
    arrays, state = ball_arrays(), Ball().state_dict()
    if path.suffix == ".npz":
        np.savez_compressed(path, **arrays)  # pyright: ignore
    elif path.suffix == ".safetensors":
        save_file(state, path)
    elif path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            for i, k in enumerate(("layers.0", "layers.2")):
                group = file.create_group(f"dense_{i}/dense_{i}")
                group["kernel:0"], group["bias:0"] = arrays[f"{k}.weight"].T, arrays[f"{k}.bias"]
    else:
        torch.save({"epoch": 3, "model": state, "optimizer": {"x": torch.zeros(3)}}, path)
    return path


FORMATS = [".npz", ".safetensors", ".h5", ".ckpt"]


@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_gives_the_same_ball(tmp_path: Path, suffix: str) -> None:
    path = write_ball(tmp_path / f"ball{suffix}")
    found = sniff(path)
    assert found is not None
    assert found.confidence == 0.6
    surface = open_neural(path, NeuralConfig(resolution=48))
    base = check_base_mesh(surface.base_mesh.extract(200))
    assert (base.components, base.genus) == (1, 0)
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(500, 3))
    points = torch.from_numpy(0.62 * direction / np.linalg.norm(direction, axis=1, keepdims=True))
    answer = surface.projector.project(points)
    assert bool(answer.converged.all())
    with torch.no_grad():
        torch.testing.assert_close(Ball()(answer.points.float()), torch.zeros(500), atol=2e-6, rtol=0)
    assert answer.normals is not None
    assert float((answer.normals * points).sum(dim=1).min()) > 0.4


def test_fingerprint_is_of_the_network_not_of_its_file(tmp_path: Path) -> None:
    prints = {open_neural(write_ball(tmp_path / f"b{s}"), NeuralConfig()).fingerprint for s in FORMATS}
    assert len(prints) == 1
    other = open_neural(tmp_path / "b.npz", NeuralConfig(iso=0.1)).fingerprint
    assert other not in prints


def test_inside_above_and_the_iso_value(tmp_path: Path) -> None:
    turned = {name: -array if name.startswith("layers.2") else array for name, array in ball_arrays().items()}
    np.savez(tmp_path / "turned.npz", **turned)  # pyright: ignore
    surface = open_neural(tmp_path / "turned.npz", NeuralConfig())
    assert any("inside is taken to be above it" in note for note in surface.notes)
    smaller = open_neural(write_ball(tmp_path / "ball.npz"), NeuralConfig(iso=-0.2))
    for opened, radius in ((surface, 0.6), (smaller, 0.4)):
        points, _ = opened.sample(2000, np.random.default_rng(0))  # pyright: ignore
        np.testing.assert_allclose(np.linalg.norm(points, axis=1).mean(), radius, rtol=0.05)
    with pytest.raises(InputError, match="is not between -1 and 1, all that a tanh gives"):
        open_neural(tmp_path / "ball.npz", NeuralConfig.model_validate({"iso": 2, "network": {"output": "tanh"}}))


def test_a_level_set_that_reaches_the_box_is_capped_and_said(tmp_path: Path) -> None:
    box = ((-1.0, -1.0, -1.0), (0.3, 1.0, 1.0))
    surface = open_neural(write_ball(tmp_path / "ball.npz"), NeuralConfig(bounds=box, resolution=64))
    assert any("closed there with a flat cap" in note for note in surface.notes)
    base = surface.base_mesh.extract(400)
    assert check_base_mesh(base).genus == 0
    assert abs(base.vertices[:, 0].max() - 0.3) < 0.02
    points = torch.tensor([[0.31, 0.05, 0.02], [0.28, -0.1, 0.1]], dtype=torch.float64)
    answer = surface.projector.project(points)
    assert bool(answer.converged.all())
    np.testing.assert_allclose(answer.points[:, 0], 0.3, atol=1e-9)


def test_descriptions_beside_the_weights(tmp_path: Path) -> None:
    path = write_ball(tmp_path / "ball.npz")
    (tmp_path / "ball.toml").write_text('iso = -0.1\n[network]\nactivation = "leaky_relu"\nslope = 0.2\n')
    surface = open_neural(path, NeuralConfig())
    assert any("described by ball.toml" in note for note in surface.notes)
    assert any("leaky_relu" in note for note in surface.notes)
    own = NeuralConfig.model_validate({"network": {"activation": "relu"}})
    assert any("60 relu" in note for note in open_neural(path, own).notes)
    other = tmp_path / "other.json"
    for text, words in (
        ('{"resolution": 3}', "'resolution' is not one of"),
        ('{"network": {"activation": "gelu"}}', "network.activation"),
        ('{"network": 3}', "network"),
        ("[1]", "need a table"),
        ("{", "line 1"),
    ):
        other.write_text(text)
        with pytest.raises(InputError, match=words):
            open_neural(path, NeuralConfig(description=str(other)))
    with pytest.raises(InputError, match="No such file"):
        open_neural(path, NeuralConfig(description=str(tmp_path / "none.toml")))


def test_a_neus_checkpoint_at_its_initialisation_is_a_ball(tmp_path: Path) -> None:
    """The geometric initialisation makes a sphere of the radius of its bias, 0.6 / scale."""
    torch.manual_seed(0)
    network = NeusSdf(width=128, octaves=6, outputs=5, scale=1.0)
    torch.save({"sdf_network_fine": network.state_dict(), "iter_step": 7}, tmp_path / "neus.pth")
    assert (sniff(tmp_path / "neus.pth") or pytest.fail("not seen")).confidence == 0.6
    surface = open_neural(tmp_path / "neus.pth", NeuralConfig(resolution=48))
    assert any("neus" in note for note in surface.notes)
    points, _ = surface.sample(500, np.random.default_rng(0))  # pyright: ignore
    with torch.no_grad():
        torch.testing.assert_close(network(torch.from_numpy(points).float()), torch.zeros(500), atol=1e-5, rtol=0)
    assert abs(np.linalg.norm(points, axis=1).mean() - 0.6) < 0.15


def test_functions_and_modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        "import torch\nlayer = torch.nn.Linear(3, 1)\n"
        "def net(points):\n    return points.norm(dim=1) - 0.5 + 0 * layer(points)[:, 0]\n"
        "net.bounds = [[-1, -1, -1], [1, 1, 1]]\n"
    )
    surface = ndf_core.open("mine.py:net", repr="neural", resolution=32)
    answer = surface.projector.project(torch.tensor([[0.6, 0.0, 0.0]], dtype=torch.float64))
    np.testing.assert_allclose(answer.points, [[0.5, 0, 0]], atol=1e-6)
    opened = open_neural(Ball(), NeuralConfig(resolution=32))
    assert check_base_mesh(opened.base_mesh.extract(100)).genus == 0


def test_the_empty_network_is_refused(shared_data: Path) -> None:
    with pytest.raises(InputError, match="no zero level set between"):
        ndf_core.open(shared_data / "neural/thingi_95444_empty.h5")


@pytest.mark.parametrize(
    ("name", "genus"), [("niq_bunny.npz", 0), ("niq_hammer.npz", 0), ("thingi_441708.h5", 0), ("thingi_41969.h5", 1)]
)
def test_real_networks_converge_near_their_surface(shared_data: Path, name: str, genus: int) -> None:
    surface = ndf_core.open(shared_data / "neural" / name, resolution=64)
    assert surface.representation == "neural"
    base = surface.base_mesh.extract(1000)
    assert check_base_mesh(base).genus == genus
    size = float(np.ptp(base.vertices, axis=0).max())
    points, _ = surface.sample(3000, np.random.default_rng(0))  # pyright: ignore
    noise = np.random.default_rng(1).normal(size=points.shape) * 0.005 * size
    answer = surface.projector.project(torch.from_numpy(points + noise))
    assert float(answer.converged.double().mean()) > 0.999
    moved = (answer.points - torch.from_numpy(points + noise)).norm(dim=1)
    # Nearest points are at most as far as the sample that the query was made from.
    excess = (moved - torch.from_numpy(np.linalg.norm(noise, axis=1))) / size
    assert float(excess.quantile(0.99)) < 1e-4


@pytest.mark.parametrize("suffix", FORMATS)
def test_files_cut_off_anywhere_are_one_error(tmp_path: Path, suffix: str) -> None:
    data = write_ball(tmp_path / f"whole{suffix}").read_bytes()
    path = tmp_path / f"cut{suffix}"
    for tenth in range(10):
        path.write_bytes(data[: len(data) * tenth // 10])
        sniff(path)
        with pytest.raises(InputError, match="cut"):
            open_neural(path, NeuralConfig())


def test_code_in_files_does_not_run(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> Any:
            return (Path.touch, (tmp_path / "ran",))

    torch.save({"model": Ball().state_dict(), "evil": Evil()}, tmp_path / "evil.ckpt")
    np.savez(tmp_path / "evil.npz", **ball_arrays(), evil=np.array([Evil()], dtype=object))  # pyright: ignore
    with pytest.raises(InputError, match="holds more than weights"):
        open_neural(tmp_path / "evil.ckpt", NeuralConfig())
    with pytest.raises(InputError, match="not numbers"):
        open_neural(tmp_path / "evil.npz", NeuralConfig())
    assert not (tmp_path / "ran").exists()


def test_exported_programs_need_trust(tmp_path: Path) -> None:
    exported = torch.export.export(Ball(), (torch.zeros(5, 3),), dynamic_shapes=({0: torch.export.Dim("n", min=2)},))
    torch.export.save(exported, tmp_path / "ball.pt2")
    assert (sniff(tmp_path / "ball.pt2") or pytest.fail("not seen")).confidence == 0.6
    with pytest.raises(InputError, match="--trust-program"):
        open_neural(tmp_path / "ball.pt2", NeuralConfig())
    surface = open_neural(tmp_path / "ball.pt2", NeuralConfig(trust_program=True, resolution=32))
    assert check_base_mesh(surface.base_mesh.extract(100)).genus == 0


def test_hdf5_links_out_of_the_file_are_not_followed(tmp_path: Path) -> None:
    write_ball(tmp_path / "other.h5")
    with h5py.File(tmp_path / "links.h5", "w") as file:
        file["dense"] = h5py.ExternalLink("other.h5", "/dense_0")
    with pytest.raises(InputError, match="is a link to somewhere else"):
        open_neural(tmp_path / "links.h5", NeuralConfig())
    with h5py.File(tmp_path / "huge.h5", "w") as file:
        file.create_dataset("dense/kernel:0", (1 << 20, 1 << 20), "f4", chunks=(64, 64))
    with pytest.raises(InputError, match="bytes, more than"):
        open_neural(tmp_path / "huge.h5", NeuralConfig())


def test_lying_headers(tmp_path: Path) -> None:
    header = json.dumps({"a.weight": {"dtype": "F32", "shape": [1 << 31, 3], "data_offsets": [0, 12]}}).encode()
    (tmp_path / "lie.safetensors").write_bytes(len(header).to_bytes(8, "little") + header + bytes(12))
    (tmp_path / "noise.npz").write_bytes(b"PK\x03\x04" + bytes(range(256)) * 10)
    (tmp_path / "text.h5").write_text("nothing")
    for name in ("lie.safetensors", "noise.npz", "text.h5"):
        with pytest.raises(InputError, match=name):
            open_neural(tmp_path / name, NeuralConfig())

"""The base mesh's bytes: exact, bounded, and refused when they are not what the header says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import bumpy, mesh_of, sheet, tetrahedron, torus

from ndf_core.asset.base_mesh_codec import box_frame, decode_base_mesh, encode_integer_mesh
from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.base_mesh.quantise import encode_base_mesh
from ndf_core.errors import AssetError, BaseMeshError
from ndf_core.interfaces import BaseMesh
from ndf_core.mesh import topology


def _rows(array: np.ndarray) -> np.ndarray:
    return array[np.lexsort(array.T)]


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_integers_survive(bits: int) -> None:
    vertices, faces = mesh_of(torus, 16)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    grid = np.rint((vertices - low) / (high - low).max() * ((1 << bits) - 1)).astype(np.int64)
    blob = encode_integer_mesh(grid, faces, bits)
    points, corners = decode_base_mesh(blob, len(vertices), len(faces))
    assert np.array_equal(_rows(points), _rows(box_frame(grid)))
    assert topology(corners, len(points)) == topology(faces, len(vertices))
    assert np.ptp(points, axis=0).max() == 3.0
    assert np.array_equal(points.max(axis=0), -points.min(axis=0))


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (1e6, 1e6), (1e-6, 1e-6), (1e-3, 1e3)])
def test_encoding_stays_within_half_a_step(scale: float, offset: float) -> None:
    vertices, faces = mesh_of(bumpy, 32)
    mesh = coarsen(vertices * scale + offset, faces, 500)
    encoded = encode_base_mesh(mesh, bits=12)
    assert encoded.bits == 12
    again = decode_base_mesh(encoded.blob, len(encoded.vertices), len(encoded.faces))
    assert np.array_equal(again[0], encoded.vertices) and np.array_equal(again[1], encoded.faces)
    back = encoded.vertices * encoded.scale + encoded.center
    step = np.ptp(mesh.vertices, axis=0).max() / 4095
    nearest = np.abs(back[:, None] - mesh.vertices[None]).max(axis=2).min(axis=1)
    assert nearest.max() <= 0.5 * step * (1 + 1e-6)
    assert topology(encoded.faces, len(back)) == topology(mesh.faces, len(mesh.vertices))


def test_thin_parts_take_more_bits() -> None:
    vertices, faces = tetrahedron()
    spike = np.concatenate([vertices * [1, 1e-4, 1e-4], vertices * 1e-4 + [0.0, 0.5, 0]])
    mesh = BaseMesh(spike, np.concatenate([faces, faces + 4]))
    assert 12 < encode_base_mesh(mesh, bits=12).bits <= 16


def test_parts_thinner_than_the_finest_grid_are_refused() -> None:
    vertices, faces = tetrahedron()
    far = np.concatenate([vertices, vertices * 1e-6 + 5])
    with pytest.raises(BaseMeshError, match="16 bits.*coincide.*tiny parts"):
        encode_base_mesh(BaseMesh(far, np.concatenate([faces, faces + 4])))


def test_open_meshes_are_stored_too() -> None:
    mesh = BaseMesh(*sheet(6))
    encoded = encode_base_mesh(mesh)
    assert topology(encoded.faces, len(encoded.vertices)) == topology(mesh.faces, len(mesh.vertices))


def _blob() -> tuple[bytes, int, int]:
    encoded = encode_base_mesh(coarsen(*mesh_of(bumpy, 16), 60))
    return encoded.blob, len(encoded.vertices), len(encoded.faces)


def test_other_counts_are_refused_before_decoding() -> None:
    blob, vertices, faces = _blob()
    for counts in ((vertices + 1, faces), (vertices, faces - 1), (0, 0), (2**31, 2**31)):
        with pytest.raises(AssetError, match="damaged"):
            decode_base_mesh(blob, *counts)


def test_a_header_that_asks_for_billions_is_refused() -> None:
    blob, vertices, faces = _blob()
    with pytest.raises(AssetError, match="expected"):
        decode_base_mesh(blob[:12] + b"\xff\xff\xff\xff\x07" * 2 + blob[14:], vertices, faces)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_damage_is_an_error_or_a_mesh_of_the_right_size(data: st.DataObject) -> None:
    blob, vertices, faces = _blob()
    cut = data.draw(st.integers(0, len(blob)))
    broken = bytearray(blob[:cut]) if data.draw(st.booleans()) else bytearray(blob)
    for _ in range(data.draw(st.integers(0, 3))):
        if broken:
            broken[data.draw(st.integers(0, len(broken) - 1))] = data.draw(st.integers(0, 255))
    try:
        points, corners = decode_base_mesh(bytes(broken), vertices, faces)
    except AssetError:
        return
    assert points.shape == (vertices, 3) and corners.shape == (faces, 3)
    assert np.isfinite(points).all() and corners.min() >= 0 and corners.max() < vertices


def test_coordinates_off_the_grid_are_not_encoded() -> None:
    _, faces = tetrahedron()
    with pytest.raises(ValueError, match="coordinates"):
        encode_integer_mesh(np.full((4, 3), 300), faces, 8)

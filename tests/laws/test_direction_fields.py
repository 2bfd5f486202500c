"""Direction fields and stripes against closed forms: sphere, torus, plane."""

from __future__ import annotations

import numpy as np
import pytest
from small_assets import icosphere, torus
from solids import sheet

from ndf_core.errors import InputError
from ndf_core.processing.direction_fields import DirectionField, direction_field
from ndf_core.processing.operators import Operators
from ndf_core.processing.stripes import Stripes, phase_gradients, stripe_pattern
from ndf_core.processing.tangent_frames import TangentFrames

SPHERE = Operators(*icosphere(4))
RING = Operators(*torus(72, 36))


def plane(side: int) -> Operators:
    """The upper one of two squares."""
    vertices, faces = sheet(side)
    return Operators(vertices, faces[: side * side * 2] if len(faces) > 2 * side * side else faces)


@pytest.mark.parametrize("degree", [1, 2, 4, 6])
@pytest.mark.parametrize(("mesh", "characteristic"), [(SPHERE, 2), (RING, 0)])
def test_indices_add_up_to_the_euler_characteristic(mesh: Operators, characteristic: int, degree: int) -> None:
    field = direction_field(mesh, degree)
    assert field.index_sum == field.frames.euler_characteristic == characteristic
    assert np.abs(field.representative) == pytest.approx(1)


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_the_least_energy_on_the_unit_sphere_is_the_degree(degree: int) -> None:
    """The connection Laplacian of the n-th power of the tangent bundle has the eigenvalue n there, and none below."""
    errors = [abs(direction_field(Operators(*icosphere(k)), degree).energy - degree) / degree for k in (2, 3, 4)]
    assert errors[2] < 3e-3
    assert errors[2] < 0.35 * errors[1] < 0.35 * 0.35 * errors[0] or max(errors) < 1e-4


def test_angles_close_around_every_vertex_and_transport_is_undone_by_the_way_back() -> None:
    frames = TangentFrames(SPHERE)
    twins = frames.twins.ravel()
    assert np.abs(np.exp(1j * frames.angles[twins]) - np.exp(1j * frames.back_angles)).max() < 1e-12
    assert np.abs(frames.transport * frames.transport[twins] - 1).max() < 1e-12
    turn = np.angle(frames.transport.reshape(-1, 3).prod(axis=1))
    assert turn.sum() == pytest.approx(4 * np.pi, rel=1e-9), "Gauss and Bonnet"


def test_vectors_in_space_and_back() -> None:
    frames = TangentFrames(RING)
    directions = np.exp(1j * np.random.default_rng(0).random(len(frames.vertices)) * 6)
    vectors = frames.vectors(directions)
    assert np.linalg.norm(vectors, axis=1) == pytest.approx(1)
    assert np.abs(frames.directions(vectors) - directions).max() < 1e-12


def around(mesh: Operators) -> np.ndarray:
    """Unit vectors around the z axis."""
    x, y, _ = mesh.vertices.T
    vectors = np.stack([-y, x, 0 * x], axis=1)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def test_an_aligned_field_follows_and_smoothness_loosens_it() -> None:
    wanted = around(RING)
    noisy = wanted + 0.5 * np.random.default_rng(1).normal(size=wanted.shape)
    close = direction_field(RING, 1, noisy, smoothness=1e-4)
    loose = direction_field(RING, 1, noisy, smoothness=0.1)
    agreement = [(field.vectors * wanted).sum(axis=1).mean() for field in (close, loose)]
    assert agreement[0] < 0.97 < agreement[1]
    lines = direction_field(RING, 2, wanted * np.random.default_rng(2).choice([-1, 1], (len(wanted), 1)), 1e-3)
    assert np.abs((lines.vectors * wanted).sum(axis=1)).min() > 0.99, "the sign of a line means nothing"


def mean_frequency(stripes: Stripes, field: DirectionField) -> float:
    even = (stripes.indices == 0) & ~stripes.branched
    areas = field.frames.areas * even
    return float((phase_gradients(field.frames, stripes.phases) * areas).sum() / areas.sum())


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("period", [0.12, 0.31])
def test_stripes_on_a_plane_have_the_period_asked_for(period: float, degree: int) -> None:
    mesh = plane(24)
    wanted = np.tile([np.cos(0.4), np.sin(0.4), 0.0], (len(mesh.vertices), 1))
    field = direction_field(mesh, degree, wanted, 1e-3)
    stripes = stripe_pattern(field, period)
    assert not stripes.indices.any() and not stripes.branched.any()
    assert mean_frequency(stripes, field) == pytest.approx(2 * np.pi / period, rel=0.05)
    # Along the direction the cosine repeats with the period.
    phase = mesh.vertices @ wanted[0] * 2 * np.pi / period
    both = np.abs(np.mean(np.exp(1j * phase) * (stripes.cosines + 0j)))
    assert both == pytest.approx(0.5, abs=0.05)


def test_stripes_along_the_circles_of_a_torus_close_up() -> None:
    """The small circles have the circumference 2 pi 0.4: eight stripes fit, nothing is singular."""
    mesh, period = RING, 2 * np.pi * 0.4 / 8
    x, y, z = mesh.vertices.T
    radius = np.hypot(x, y)
    out = np.stack([x / radius, y / radius, 0 * x], axis=1)
    wanted = ((radius - 1)[:, None] * [0, 0, 1] - z[:, None] * out) / 0.4
    field = direction_field(mesh, 1, wanted, 1e-4)
    stripes = stripe_pattern(field, period)
    assert not stripes.indices.any()
    assert mean_frequency(stripes, field) == pytest.approx(2 * np.pi / period, rel=0.05)


def test_stripes_around_a_sphere_branch_where_they_must() -> None:
    """Two fields of half an index at either pole: the smoothest line field has index 2 in all."""
    field = direction_field(SPHERE, 2)
    stripes = stripe_pattern(field, 0.5)
    assert stripes.branched.sum() == 4
    assert mean_frequency(stripes, field) == pytest.approx(2 * np.pi / 0.5, rel=0.1)


def test_what_is_wrong_is_said() -> None:
    field = direction_field(SPHERE, 1)
    nothing = np.zeros_like(SPHERE.vertices)
    cases = [
        (lambda: direction_field(SPHERE, 0), "must be 1 to 12"),
        (lambda: direction_field(SPHERE, 1, nothing[:5]), "need 2,562 finite vectors"),
        (lambda: direction_field(SPHERE, 1, nothing * np.nan), "finite vectors"),
        (lambda: direction_field(SPHERE, 1, nothing), "all vectors are zero, or normal"),
        (lambda: direction_field(SPHERE, 1, SPHERE.vertices * 0 + 1, -1.0), "must be positive"),
        (lambda: stripe_pattern(field, -1.0), "must be positive"),
        (lambda: stripe_pattern(field, 1e-3), "at least two edges long"),
        (lambda: stripe_pattern(direction_field(SPHERE, 4), 0.5), "degree 4"),
    ]
    for call, message in cases:
        with pytest.raises(InputError, match=message):
            call()
    bow = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0.0]])
    with pytest.raises(InputError, match="oriented manifold: .* 1 vertices where surfaces meet"):
        direction_field(Operators(bow, np.array([[0, 1, 2], [0, 3, 4]], dtype=np.int32)))

"""First-order geometry of the mapped surface against finite differences and against maps that are known exactly."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from small_surfaces import (
    affine_parameters,
    base_points,
    doubled,
    in_double,
    random_parameters,
    small_geometry,
)
from torch import Tensor

from ndf_core.fitting.geometry import (
    BaseGeometry,
    Frame,
    area_ratio,
    barycentric_rates,
    base_frames,
    mapped_frame,
    pushforward,
)
from ndf_core.fitting.network import Parameters, displace, interpolate
from ndf_core.fitting.sampling import mapped_areas

ROWS = 200
CASES = {
    "plain": {},
    "no features": {"feature_dim": 0},
    "no waves": {"levels": 0},
    "neither": {"levels": 0, "feature_dim": 0},
    "deep": {"hidden_layers": 3, "feature_dim": 9},
    "eight octaves": {"levels": 8},
}
LINEAR = np.array([[1.3, 0.2, -0.4], [0.1, 0.7, 0.3], [-0.2, 0.5, 1.1]])


def image(parameters: Parameters, geometry: BaseGeometry, face: Tensor, barycentric: Tensor) -> Tensor:
    features = interpolate(parameters.features, geometry.faces[face], barycentric)
    return displace(parameters, geometry.positions(face, barycentric), features)


def differences(
    parameters: Parameters, geometry: BaseGeometry, face: Tensor, barycentric: Tensor, tangent: Tensor
) -> Tensor:
    """Central differences of g along a tangent, with weights found by solving for x +- h t in the face's plane."""
    h = 1e-6
    corners = geometry.corner_positions[face].numpy()
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    ends: list[Tensor] = []
    for sign in (1, -1):
        moved = geometry.positions(face, barycentric).numpy() + sign * h * tangent.numpy() - corners[:, 0]
        weights = np.stack([np.linalg.lstsq(e, x, rcond=None)[0] for e, x in zip(edges, moved, strict=True)])
        full = torch.from_numpy(np.concatenate([1 - weights.sum(1, keepdims=True), weights], axis=1))
        ends.append(image(parameters, geometry, face, full))
    return (ends[0] - ends[1]) / (2 * h)


def unit(vectors: Tensor) -> Tensor:
    return torch.nn.functional.normalize(vectors, dim=1)


class TestFiniteDifferences:
    """Float32 derivatives against float64 differences, to 1e-4 of the Jacobian's size (at least 1)."""

    @pytest.mark.parametrize("options", CASES.values(), ids=CASES)
    def test_pushforward_normals_and_jacobian(self, options: dict[str, int]) -> None:
        geometry = small_geometry()
        parameters = random_parameters(geometry, **options)
        face, barycentric = base_points(geometry, ROWS)
        mapped = mapped_frame(parameters, geometry, face, barycentric)

        fine, precise = in_double(small_geometry()), doubled(parameters)
        frames, weights = base_frames(fine, face), barycentric.double()
        one = differences(precise, fine, face, weights, frames.first)
        two = differences(precise, fine, face, weights, frames.second)
        size = torch.linalg.vector_norm(torch.stack([one, two], 1), dim=(1, 2)).clamp_min(1)
        tangents = torch.stack([frames.first, frames.second], 1).float()
        value, columns = pushforward(parameters, geometry, face, barycentric, tangents)
        torch.testing.assert_close(value.double(), image(precise, fine, face, weights), rtol=0, atol=1e-6)
        error = torch.linalg.vector_norm(columns.double() - torch.stack([one, two], 1), dim=(1, 2))
        assert float((error / size).max()) < 1e-4

        cross = torch.linalg.cross(one, two)
        ratio = torch.linalg.vector_norm(cross, dim=1)
        # A normal turns faster the thinner the mapped patch is.
        slack = 1e-4 * (size.square() / ratio).clamp_min(1)
        assert bool((torch.linalg.vector_norm(mapped.frame.normal - unit(cross), dim=1) < slack).all())
        assert float(((mapped.area_ratio - ratio).abs() / size.square()).max()) < 1e-4
        first = unit(one)
        second = torch.linalg.cross(unit(cross), first)
        jacobian = torch.stack([first, second], 1) @ torch.stack([one, two], 2)
        error = torch.linalg.vector_norm(mapped.jacobian - jacobian, dim=(1, 2))
        assert bool((error / size < slack).all())

    def test_the_features_have_a_part_in_it(self) -> None:
        """Autograd through the positions alone, the trap, is far from the differences that the test above uses."""
        geometry = in_double(small_geometry())
        parameters = doubled(random_parameters(geometry))
        face, barycentric = base_points(geometry, ROWS)
        tangent = base_frames(geometry, face).first
        features = interpolate(parameters.features, geometry.faces[face], barycentric)
        _, without = torch.func.jvp(
            lambda x: displace(parameters, x, features), (geometry.positions(face, barycentric),), (tangent,)
        )
        expected = differences(parameters, geometry, face, barycentric, tangent)
        assert float(torch.linalg.vector_norm(without - expected, dim=1).median()) > 0.1

    def test_gradient_of_the_area_ratio(self) -> None:
        """The losses of App. D differentiate J_theta itself."""
        geometry = in_double(small_geometry())
        start = doubled(random_parameters(geometry))
        face, barycentric = base_points(geometry, ROWS)

        def total(flat: Tensor) -> Tensor:
            return mapped_frame(Parameters(start.shape, flat), geometry, face, barycentric).area_ratio.sum()

        flat = start.flat.clone().requires_grad_()
        (gradient,) = torch.autograd.grad(total(flat), flat)
        along = torch.randn(len(flat), dtype=torch.float64, generator=torch.Generator().manual_seed(0))
        h = 1e-7
        expected = (total(start.flat + h * along) - total(start.flat - h * along)) / (2 * h)
        torch.testing.assert_close(gradient @ along, expected, rtol=1e-4, atol=0)


class TestKnownMaps:
    def test_zero_network_is_the_identity(self) -> None:
        geometry = small_geometry()
        parameters = Parameters.initial(random_parameters(geometry).shape, 0, zero_last=True, feature_scale=1.0)
        face, barycentric = base_points(geometry, ROWS)
        mapped, base = mapped_frame(parameters, geometry, face, barycentric), base_frames(geometry, face)
        torch.testing.assert_close(mapped.points, geometry.positions(face, barycentric))
        torch.testing.assert_close(mapped.area_ratio, torch.ones(ROWS))
        torch.testing.assert_close(mapped.jacobian, torch.eye(2).expand(ROWS, 2, 2), rtol=0, atol=1e-6)
        for found, expected in zip(mapped.frame, base, strict=True):
            torch.testing.assert_close(found, expected, rtol=0, atol=1e-6)

    @pytest.mark.parametrize("mirror", [1.0, -1.0])
    def test_linear_map(self, mirror: float) -> None:
        """J t = A t; the normal is that of the cofactor matrix, also where A turns the surface inside out."""
        matrix = LINEAR * np.array([1.0, 1.0, mirror])
        geometry = small_geometry()
        parameters = affine_parameters(geometry, matrix)
        face, barycentric = base_points(geometry, ROWS)
        mapped, base = mapped_frame(parameters, geometry, face, barycentric), base_frames(geometry, face)
        exact = torch.from_numpy(matrix).float()
        cofactor = torch.from_numpy(np.linalg.det(matrix) * np.linalg.inv(matrix).T).float()
        area = base.normal @ cofactor.T
        torch.testing.assert_close(mapped.points, geometry.positions(face, barycentric) @ exact.T)
        torch.testing.assert_close(mapped.area_ratio, torch.linalg.vector_norm(area, dim=1), rtol=1e-5, atol=1e-6)
        torch.testing.assert_close(mapped.frame.normal, unit(area), rtol=0, atol=1e-5)
        tangents = torch.stack([base.first, base.second], 2)
        metric = (exact @ tangents).mT @ (exact @ tangents)
        torch.testing.assert_close(mapped.jacobian.mT @ mapped.jacobian, metric, rtol=1e-5, atol=1e-5)

    def test_displaced_vertices(self) -> None:
        """Features that carry a displacement of each vertex map every face to the displaced triangle."""
        geometry = small_geometry()
        offsets = np.random.default_rng(0).normal(size=(len(geometry.vertices), 3)) * 0.2
        parameters = affine_parameters(geometry, offsets=offsets)
        triangles = (geometry.vertices.double().numpy() + offsets)[geometry.faces.numpy()]
        vectors = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        areas = np.linalg.norm(vectors, axis=1) / 2
        face, barycentric = base_points(geometry, ROWS)
        mapped = mapped_frame(parameters, geometry, face, barycentric)
        ratio = torch.from_numpy(areas / geometry.areas.numpy()).float()
        normals = torch.from_numpy(vectors / (2 * areas[:, None])).float()
        torch.testing.assert_close(mapped.area_ratio, ratio[face], rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(mapped.frame.normal, normals[face], rtol=0, atol=1e-4)
        torch.testing.assert_close(
            area_ratio(parameters, geometry, face, barycentric), ratio[face], rtol=1e-4, atol=1e-5
        )
        torch.testing.assert_close(
            mapped_areas(geometry, parameters), torch.from_numpy(areas).float(), rtol=1e-4, atol=1e-6
        )

    def test_a_map_to_a_point_stays_finite(self) -> None:
        geometry = small_geometry()
        mapped = mapped_frame(affine_parameters(geometry, np.zeros((3, 3))), geometry, *base_points(geometry, ROWS))
        assert float(mapped.area_ratio.max()) < 1e-12
        assert all(bool(torch.isfinite(tensor).all()) for tensor in (*mapped.frame, mapped.jacobian))


@pytest.mark.parametrize("options", CASES.values(), ids=CASES)
def test_area_ratio_is_that_of_the_frame(options: dict[str, int]) -> None:
    geometry = small_geometry()
    parameters = random_parameters(geometry, **options)
    face, barycentric = base_points(geometry, ROWS)
    mapped = mapped_frame(parameters, geometry, face, barycentric)
    torch.testing.assert_close(
        area_ratio(parameters, geometry, face, barycentric), mapped.area_ratio, rtol=1e-4, atol=1e-5
    )
    torch.testing.assert_close(torch.linalg.det(mapped.jacobian), mapped.area_ratio, rtol=1e-4, atol=1e-4)


def test_frames_are_orthonormal_and_right_handed() -> None:
    geometry = small_geometry()
    face, barycentric = base_points(geometry, ROWS)
    mapped = mapped_frame(random_parameters(geometry), geometry, face, barycentric)
    for frame in (mapped.frame, base_frames(geometry, face)):
        matrix = torch.stack([frame.first, frame.second, frame.normal], 2)
        torch.testing.assert_close(matrix.mT @ matrix, torch.eye(3).expand(ROWS, 3, 3), rtol=0, atol=1e-5)
        torch.testing.assert_close(torch.linalg.det(matrix), torch.ones(ROWS))


def test_base_frames_lie_in_their_faces_and_look_outwards() -> None:
    geometry = small_geometry()
    face = torch.arange(len(geometry.faces))
    frame: Frame = base_frames(geometry, face)
    a, b, c = geometry.corner_positions.unbind(1)
    for edge in (b - a, c - a):
        torch.testing.assert_close((frame.normal * edge).sum(1), torch.zeros(len(face)), rtol=0, atol=1e-6)
    assert float((frame.normal * (a + b + c)).sum(1).min()) > 0


def test_barycentric_rates_move_the_point_along_the_tangent() -> None:
    """Sum of rates times corners is t; the weights keep their sum. Slivers included."""
    rng = np.random.default_rng(0)
    triangles = torch.from_numpy(rng.normal(size=(50, 3, 3)))
    triangles[:10, 2] = triangles[:10, 0] + 0.3 * (triangles[:10, 1] - triangles[:10, 0])
    triangles[:10, 2] += 1e-3 * torch.from_numpy(rng.normal(size=(10, 3)))
    mix = torch.from_numpy(rng.normal(size=(50, 4, 2)))
    edges = triangles[:, 1:] - triangles[:, :1]
    tangents = mix @ edges
    rates = barycentric_rates(triangles, tangents)
    torch.testing.assert_close(rates @ triangles, tangents, rtol=0, atol=1e-8)
    torch.testing.assert_close(rates.sum(-1), torch.zeros(50, 4, dtype=torch.float64), rtol=0, atol=1e-8)
    torch.testing.assert_close(rates[:, :, 1:], mix, rtol=0, atol=1e-6)

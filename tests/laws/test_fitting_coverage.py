"""Uncovered spots: which are found, with which base points; that pulls cover them; that runs stay repeatable."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from small_assets import icosphere
from small_surfaces import (
    Altered,
    SphereProjector,
    affine_parameters,
    small_geometry,
    tiny_config,
    without_normals,
)
from torch import Tensor

from ndf_core.fitting.blocks import NumpyField
from ndf_core.fitting.coverage import closest_base_points, uncovered
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.identity import initial_parameters
from ndf_core.fitting.losses import Anchors
from ndf_core.fitting.measure import dense_map
from ndf_core.fitting.network import Parameters, displace, interpolate
from ndf_core.fitting.observer import Silent
from ndf_core.fitting.projection import BoxProjector
from ndf_core.fitting.samples import Samples
from ndf_core.fitting.sampling import base_points_at, generator_at, joined, stratified
from ndf_core.fitting.trainer import Trainer
from ndf_core.interfaces import Projection, Projector
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.surfaces.closest_point_projector import ClosestPointProjector

ORIGIN = np.zeros(3)
UNIT_SPHERE = SphereProjector((0.0, 0.0, 0.0), 1.0)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def dented_sphere() -> tuple[BaseGeometry, Parameters]:
    """The unit sphere with one vertex of its base mesh mapped inwards."""
    points, faces = icosphere(3)
    geometry = BaseGeometry(points, faces.astype(np.int32))
    offsets = np.zeros((len(points), 3), np.float32)
    offsets[0] = -0.25 * points[0]
    return geometry, affine_parameters(geometry, offsets=offsets)


def found_by(projector: Projector, geometry: BaseGeometry, parameters: Parameters) -> Anchors | None:
    rng = np.random.default_rng(5)
    return uncovered(parameters, geometry, BoxProjector(projector, ORIGIN, 1.0), 20_000, rng)


class TestWhatIsFound:
    def test_points_over_the_dent_and_nothing_else(self) -> None:
        """Facing the dent, with base points in its faces; the closest point of the map is no farther than theirs."""
        geometry, parameters = dented_sphere()
        found = found_by(UNIT_SPHERE, geometry, parameters)
        assert found is not None and len(found.targets) > 5
        top = geometry.vertices[0]
        assert float((found.targets @ top).min()) > 0.97
        in_dent = (geometry.faces[found.base.face] == 0).any(1)
        assert float(in_dent.float().mean()) > 0.8
        torch.testing.assert_close(found.targets.norm(dim=1), torch.ones(len(found.targets)))

        field = NumpyField(parameters, geometry)
        dense = dense_map(len(geometry.faces), field.map, 80_000)
        closest = TriangleBVH(dense.vertices, dense.triangles).closest(found.targets.double().numpy())[0]
        exact = np.linalg.norm(closest - found.targets.numpy(), axis=1)
        mapped = field.map(found.base.face.numpy(), found.base.barycentric.numpy())
        paired = np.linalg.norm(mapped - found.targets.numpy(), axis=1)
        assert (paired < 1.02 * exact + 1e-6).all()

    def test_a_covered_surface_has_none(self) -> None:
        points, faces = icosphere(3)
        geometry = BaseGeometry(points, faces.astype(np.int32))
        found = found_by(ClosestPointProjector(points, faces), geometry, affine_parameters(geometry))
        assert found is None or not len(found.targets)

    def test_nothing_across_a_thin_wall_or_without_normals(self) -> None:
        def inside_out(query: Tensor, answer: Projection) -> Projection:
            assert answer.normals is not None
            return answer._replace(normals=-answer.normals)

        geometry, parameters = dented_sphere()
        turned = found_by(Altered(UNIT_SPHERE, inside_out), geometry, parameters)
        assert turned is not None and not len(turned.targets)
        assert found_by(Altered(UNIT_SPHERE, without_normals), geometry, parameters) is None

    @pytest.mark.parametrize("value", [float("nan"), float("inf")])
    def test_a_map_that_is_not_finite_has_none(self, value: float) -> None:
        geometry, parameters = dented_sphere()
        parameters.views["forward.bias.1"].fill_(value)
        assert found_by(UNIT_SPHERE, geometry, parameters) is None

    def test_directions_are_the_normals_of_the_map(self) -> None:
        asked = Altered(UNIT_SPHERE, lambda query, answer: answer, needs_directions=True)
        geometry, parameters = dented_sphere()
        found_by(asked, geometry, parameters)
        (directions,) = asked.directions
        assert directions is not None
        torch.testing.assert_close(directions.norm(dim=1), torch.ones(len(directions), dtype=torch.float64))


def test_closest_base_points_on_flat_faces_are_exact() -> None:
    """On a linear map: the closest point of the mapped triangle, where that lies inside the face."""
    geometry = small_geometry()
    matrix = np.array([[1.2, 0.3, 0.0], [0.0, 0.9, 0.1], [0.2, 0.0, 1.1]])
    parameters = affine_parameters(geometry, matrix)
    rng = np.random.default_rng(2)
    face = np.arange(80)
    start = base_points_at(geometry, face, rng.dirichlet((1.0, 1.0, 1.0), 80))
    triangles = (geometry.corner_positions.numpy() @ matrix.T).astype(np.float64)
    goal = np.einsum("nc,ncx->nx", rng.dirichlet((4.0, 4.0, 4.0), 80), triangles)
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    targets = torch.from_numpy(goal + 0.05 * across).float()
    base, distance, normal = closest_base_points(parameters, geometry, start, targets)
    torch.testing.assert_close(distance, torch.full((80,), 0.05), atol=1e-5, rtol=0)
    torch.testing.assert_close(normal.double(), torch.from_numpy(across), atol=1e-4, rtol=0)
    far = torch.from_numpy(rng.normal(size=(80, 3))).float()
    before = (displace_at(parameters, start) - far).norm(dim=1)
    base, distance, _ = closest_base_points(parameters, geometry, start, far)
    assert bool((distance <= before + 1e-6).all())
    torch.testing.assert_close((displace_at(parameters, base) - far).norm(dim=1), distance)
    assert torch.equal(base.face, start.face) and float(base.barycentric.min()) >= 0


def displace_at(parameters: Parameters, base: Any) -> Tensor:
    features = interpolate(parameters.features, base.batch.corners, base.barycentric)
    return displace(parameters, base.batch.positions, features)


class TestPulls:
    """In the loss, in checkpoints, and in what they are for."""

    def trainer(self, **options: Any) -> Trainer:
        """A sphere with a thin spike, over a base mesh that knows nothing of the spike."""
        geometry = small_geometry()
        config = tiny_config(coverage_every=10, **options)
        projector = BoxProjector(ClosestPointProjector(*spiked_sphere()), ORIGIN, 1.0)
        return Trainer(initial_parameters(geometry, config), geometry, projector, config, Silent(), None, 1)

    def test_gradient_equals_autograd(self) -> None:
        run = self.trainer(loss={"projection": 1e4, "cycle": 0.0})
        geometry, shape = run.geometry, run.parameters.shape
        first = stratified(geometry, geometry.areas, 150, generator_at(0, 1))
        last = stratified(geometry, geometry.areas, 50, generator_at(0, 2))
        targets = last.batch.positions + 0.3
        base = joined(first, last)
        worker = run._workers[0]  # pyright: ignore[reportPrivateUsage]
        worker.gradient_of(Samples(base, targets))
        live = Parameters(shape, run.parameters.flat.clone().requires_grad_())
        mapped = displace_at(live, base)
        goal = torch.cat([run.projector.project(mapped[:150]).points, targets])
        loss = 1e4 * (mapped - goal).square().sum() / 200
        (expected,) = torch.autograd.grad(loss, live.flat)
        torch.testing.assert_close(worker.gradient.flat, expected, rtol=1e-3, atol=1e-3)

    @pytest.mark.parametrize("edges", [(0, 200), (0, 70, 200), (0, 160, 200), (0, 10, 150, 151, 200)])
    def test_each_row_goes_to_its_own_target(self, edges: tuple[int, ...]) -> None:
        """However the rows are shared out, with planes or without."""
        geometry = small_geometry()
        base = stratified(geometry, geometry.areas, 200, generator_at(0, 1))
        mapped, targets = base.batch.positions * 1.1, torch.randn(50, 3)
        projector = BoxProjector(UNIT_SPHERE, ORIGIN, 1.0)
        expected = torch.cat([projector.project(mapped).points[:150], targets])
        for planes in (None, projector.project(mapped)):
            samples = Samples(base, targets, planes)
            parts = [
                samples.project(slice(a, b), mapped[a:b], lambda a=a, b=b: projector.project(mapped[a:b]))[0].points
                for a, b in itertools.pairwise(edges)
            ]
            torch.testing.assert_close(torch.cat(parts), expected)

    @pytest.mark.parametrize(
        "options", [{}, {"projection_visits": 2}, {"resample_every": 3, "sampling": "rejection"}]
    )
    def test_from_any_checkpoint_to_the_same_end(self, options: dict[str, Any]) -> None:
        options = {"steps": 48, "checkpoint_seconds": 1e-9, **options}
        whole = self.trainer(**options)
        states: list[dict[str, Tensor]] = []
        whole.run(48, lambda: states.append({name: tensor.clone() for name, tensor in whole.state.items()}))
        pulling = [state for state in states if len(state["coverage.targets"])]
        assert whole.pulled > 0 and not len(whole.state["coverage.targets"])
        for state in (states[0], pulling[0], pulling[-1], states[-2]):
            resumed = self.trainer(**options)
            resumed.load_state(state)
            resumed.run(48, lambda: None)
            assert torch.equal(resumed.parameters.flat, whole.parameters.flat)
            assert resumed.pulled == whole.pulled

    def test_few_rows_are_pulls(self) -> None:
        """However much is uncovered, projections have most of each batch."""
        run = self.trainer(steps=30)
        run.run(30, lambda: None)
        assert 0 < run.pulled <= 20 * (200 // 16)
        assert run.projected == 30 * 200

    def test_a_spike_is_covered(self) -> None:
        """Projections of the sphere never reach up to the spike's tip; pulls do."""
        distance = [self.from_the_tip(every) for every in (0, 5)]
        assert distance[0] > 0.5
        assert distance[1] < 0.05

    def from_the_tip(self, every: int) -> float:
        geometry, options = small_geometry(), {"steps": 300, "hidden_width": 32, "batch": 400}
        config = tiny_config(coverage_every=every, **options)
        projector = BoxProjector(ClosestPointProjector(*spiked_sphere()), ORIGIN, 1.0)
        run = Trainer(initial_parameters(geometry, config), geometry, projector, config, Silent())
        run.run(300, lambda: None)
        dense = dense_map(len(geometry.faces), NumpyField(run.parameters, geometry).map, 20_000)
        tip = spiked_sphere()[0][:1]
        return float(np.linalg.norm(TriangleBVH(dense.vertices, dense.triangles).closest(tip)[0] - tip))


def spiked_sphere() -> tuple[Float[Array, "v 3"], Float[Array, "f 3"]]:
    """The unit sphere with vertex 0 at 1.6."""
    points, faces = icosphere(3)
    points = points.copy()
    points[0] *= 1.6
    return points, faces

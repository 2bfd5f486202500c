"""The optional losses: values worked out by hand, gradients by finite differences, rows that must not count."""

from __future__ import annotations

import math

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

from ndf_core.config.fit import LossWeights
from ndf_core.errors import ConfigError
from ndf_core.fitting.geometry import BaseGeometry, base_frames, mapped_frame
from ndf_core.fitting.losses import Anchors, anchor_loss, conformality_loss, normal_loss, optional_gradient
from ndf_core.fitting.network import Parameters
from ndf_core.fitting.sampling import BasePoints

ROWS = 60


def softplus_10(x: float) -> float:
    """App. D.3."""
    return math.log1p(math.exp(10 * x)) / 10


def points_of(geometry: BaseGeometry, count: int = ROWS) -> BasePoints:
    return BasePoints(geometry, *base_points(geometry, count))


def conformality(matrix: np.ndarray, side: float | None, faces: slice = slice(None)) -> float:
    geometry = small_geometry()
    base = points_of(geometry).rows(*faces.indices(ROWS)[:2])
    mapped = mapped_frame(affine_parameters(geometry, matrix), geometry, base.face, base.barycentric)
    sides = None if side is None else torch.full((len(base.face),), side)
    return float(conformality_loss(mapped, sides))


class TestValues:
    @pytest.mark.parametrize("scale", [0.1, 1.0, 3.0])
    def test_a_similarity_is_as_conformal_as_can_be(self, scale: float) -> None:
        """det J / tr J^T J = s^2 / (2 s^2), whatever s; a turn changes nothing."""
        c, s = math.cos(0.7), math.sin(0.7)
        matrix = scale * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        assert conformality(matrix, None) == pytest.approx(softplus_10(-0.5), rel=1e-3)
        assert conformality(matrix, 1.0) == pytest.approx(softplus_10(-0.5), rel=1e-3)

    def test_a_fold_costs_more_than_a_collapse(self) -> None:
        assert conformality(np.eye(3), -1.0) == pytest.approx(softplus_10(0.5), rel=1e-4)
        assert conformality(1e-3 * np.eye(3), 0.0) == pytest.approx(softplus_10(0.0), rel=1e-4)

    def test_a_stretch(self) -> None:
        """Along both tangents of one face by 2 and 1/2: det 1, trace 4 + 1/4."""
        geometry = small_geometry()
        base = points_of(geometry).rows(5, 6)
        frame = base_frames(geometry, base.face)
        one, two, normal = (vector[0].double().numpy() for vector in (frame.first, frame.second, frame.normal))
        matrix = 2 * np.outer(one, one) + 0.5 * np.outer(two, two) + np.outer(normal, normal)
        assert conformality(matrix, 1.0, slice(5, 6)) == pytest.approx(softplus_10(-1 / 4.25), rel=1e-4)

    @pytest.mark.parametrize(("turned", "expected"), [(0.0, 0.0), (math.pi / 2, 2.0), (math.pi, 4.0)])
    def test_normal(self, turned: float, expected: float) -> None:
        """|a - b|^2 = 2 - 2 cos."""
        geometry = small_geometry()
        base = points_of(geometry)
        mapped = mapped_frame(affine_parameters(geometry), geometry, base.face, base.barycentric)
        frame = mapped.frame
        normals = math.cos(turned) * frame.normal + math.sin(turned) * frame.first
        assert float(normal_loss(mapped, normals)) == pytest.approx(expected, abs=1e-5)

    def test_rows_without_a_normal_add_nothing(self) -> None:
        geometry = small_geometry()
        base = points_of(geometry)
        mapped = mapped_frame(affine_parameters(geometry), geometry, base.face, base.barycentric)
        normals = -mapped.frame.normal
        normals[: ROWS // 4] = 0
        assert float(normal_loss(mapped, normals)) == pytest.approx(4.0 * 0.75, rel=1e-5)

    def test_anchor_is_a_sum_and_its_target_the_surface_point(self) -> None:
        geometry = small_geometry()
        base = points_of(geometry, 3)
        targets = base.batch.positions + torch.tensor([[0.0, 0, 0], [3, 0, 0], [0, 1, 2]])
        assert float(anchor_loss(affine_parameters(geometry), Anchors(base, targets))) == pytest.approx(
            14.0, rel=1e-5
        )


WEIGHTS = {
    "anchor": {"anchor": 3.0},
    "normal": {"normal": 2.0},
    "conformality": {"conformality": 5.0},
    "all": {"anchor": 3.0, "normal": 2.0, "conformality": 5.0},
}


class TestGradients:
    @pytest.mark.parametrize("weights", WEIGHTS.values(), ids=WEIGHTS)
    def test_equal_to_finite_differences(self, weights: dict[str, float]) -> None:
        geometry = in_double(small_geometry())
        parameters = doubled(random_parameters(geometry))
        base, anchors, normals = self.setting(geometry)
        mapped = mapped_frame(parameters, geometry, base.face, base.barycentric)
        sides = (mapped.frame.normal * normals).sum(1).sign()
        assert 0.1 < float((sides < 0).double().mean()) < 0.9, "both sides should occur"

        def total(flat: Tensor) -> float:
            live = Parameters(parameters.shape, flat)
            frame = mapped_frame(live, geometry, base.face, base.barycentric)
            return float(
                weights.get("anchor", 0) * anchor_loss(live, anchors)
                + weights.get("normal", 0) * normal_loss(frame, normals)
                + weights.get("conformality", 0) * conformality_loss(frame, sides)
            )

        gradient = optional_gradient(parameters, geometry, base, normals, LossWeights(**weights), anchors)
        assert gradient is not None
        h = 1e-6
        for seed in range(3):
            along = torch.randn(len(gradient), dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
            expected = (total(parameters.flat + h * along) - total(parameters.flat - h * along)) / (2 * h)
            assert float(gradient @ along) == pytest.approx(expected, rel=1e-4)

    @staticmethod
    def setting(geometry: BaseGeometry) -> tuple[BasePoints, Anchors, Tensor]:
        generator = torch.Generator().manual_seed(7)
        anchors = Anchors(points_of(geometry, 4), torch.randn(4, 3, generator=generator, dtype=torch.float64))
        normals = torch.randn(ROWS, 3, generator=generator, dtype=torch.float64)
        return points_of(geometry), anchors, torch.nn.functional.normalize(normals, dim=1)

    def test_folds_are_seen_by_the_surface_normal_alone(self) -> None:
        """The same map, once under normals that agree with it and once under their opposites."""
        geometry = small_geometry()
        parameters = random_parameters(geometry)
        base = points_of(geometry)
        normals = mapped_frame(parameters, geometry, base.face, base.barycentric).frame.normal
        weights = LossWeights(conformality=1.0)
        up = optional_gradient(parameters, geometry, base, normals, weights, None)
        down = optional_gradient(parameters, geometry, base, -normals, weights, None)
        blind = optional_gradient(parameters, geometry, base, None, weights, None)
        assert up is not None and down is not None and blind is not None
        torch.testing.assert_close(blind, up)
        # Both push towards conformal patches of the right side; a folded patch has the steeper softplus.
        assert float(down.norm()) > 2 * float(up.norm())
        assert float(down @ up) < 0

    def test_rows_of_no_side_push_nothing(self) -> None:
        geometry = small_geometry()
        parameters = random_parameters(geometry)
        base = points_of(geometry)
        weights = LossWeights(conformality=1.0, normal=1.0)
        gradient = optional_gradient(parameters, geometry, base, torch.zeros(ROWS, 3), weights, None)
        assert gradient is not None
        assert not gradient.any()

    def test_none_where_all_are_off(self) -> None:
        geometry = small_geometry()
        base, anchors, normals = self.setting(geometry)
        parameters = random_parameters(geometry)
        assert optional_gradient(parameters, geometry, base, normals, LossWeights(), anchors) is None
        assert optional_gradient(parameters, geometry, base, normals, LossWeights(anchor=1.0), None) is None

    def test_a_normal_loss_needs_normals(self) -> None:
        geometry = small_geometry()
        with pytest.raises(ConfigError, match="--loss.normal needs surface normals.*leave it out"):
            optional_gradient(
                random_parameters(geometry), geometry, points_of(geometry), None, LossWeights(normal=1.0), None
            )

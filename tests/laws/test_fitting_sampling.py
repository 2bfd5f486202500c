"""Samples follow the mapped area, and depend on seed and step alone."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.stats import chisquare
from small_surfaces import affine_parameters, random_parameters, small_geometry
from torch import Tensor

from ndf_core.errors import FitError
from ndf_core.fitting.geometry import BaseGeometry, area_ratio
from ndf_core.fitting.network import Parameters
from ndf_core.fitting.sampling import BasePoints, by_rejection, generator_at, mapped_areas, stratified

CUTS = 4
"""Cells along an edge of a face, for histograms inside faces."""


def cells(base: BasePoints) -> Tensor:
    """Number of the one of CUTS^2 equal triangles of its face that each point lies in, over all faces."""
    scaled = base.barycentric.double() * CUTS
    i, j, k = scaled.floor().clamp_max(CUTS - 1).long().unbind(1)
    upright = (i + j + k == CUTS - 1).long()  # in a triangle upside down the three floors sum to one less
    return ((base.face * CUTS + i) * CUTS + j) * 2 + upright


def cell_shares(geometry: BaseGeometry, parameters: Parameters) -> Tensor:
    """Share of the mapped area in every cell, by a fine midpoint rule; |det J| cut at its 99th percentile."""
    fine = 4 * CUTS
    grid = [
        (i + third, j + third)
        for third, sum_below in ((1 / 3, fine), (2 / 3, fine - 1))
        for i in range(fine)
        for j in range(fine)
        if i + j < sum_below
    ]
    first = torch.tensor(grid, dtype=torch.float64) / fine
    local = torch.cat([first, 1 - first.sum(1, keepdim=True)], dim=1).float()
    count = len(geometry.faces)
    face = torch.arange(count).repeat_interleave(len(local))
    base = BasePoints(geometry, face, local.repeat(count, 1))
    ratio, areas = area_ratio(parameters, geometry, face, base.barycentric), geometry.areas[face]
    order = ratio.argsort()
    covered = areas[order].double().cumsum(0) / areas.double().sum()
    weight = ratio.clamp_max(float(ratio[order][torch.searchsorted(covered, 0.99)])) * areas
    shares = torch.zeros(count * CUTS * CUTS * 2, dtype=torch.float64).index_add_(0, cells(base), weight.double())
    return shares / shares.sum()


def p_value(base: BasePoints, shares: Tensor) -> float:
    """Chance of counts at least as far from the shares, were they drawn from them."""
    counts = torch.bincount(cells(base), minlength=len(shares)).double()
    assert not counts[shares == 0].any()
    kept = shares > 0
    return float(chisquare(counts[kept].numpy(), (shares[kept] * counts.sum()).numpy()).pvalue)


def smooth_field(geometry: BaseGeometry) -> Parameters:
    """A map that stretches by very different amounts, within faces as well."""
    return random_parameters(geometry, levels=1, size=1.0, seed=3)


class TestStratified:
    @pytest.mark.parametrize("count", [1, 7, 79, 80, 1000])
    @pytest.mark.parametrize("step", range(5))
    def test_every_face_gets_floor_or_ceiling_of_its_share(self, count: int, step: int) -> None:
        geometry = small_geometry()
        density = torch.from_numpy(np.random.default_rng(1).exponential(size=len(geometry.faces)) ** 2).float()
        density[::7] = 0
        base = stratified(geometry, density, count, generator_at(0, step))
        found = torch.bincount(base.face, minlength=len(density)).double()
        expected = count * density.double() / density.double().sum()
        assert int(found.sum()) == count
        assert not found[::7].any()
        assert float((found - expected).abs().max()) < 1 + 1e-6

    def test_no_face_is_preferred(self) -> None:
        """Over many draws even small faces get their share."""
        geometry = small_geometry()
        density = torch.linspace(0.1, 1, len(geometry.faces))
        total = torch.zeros(len(density), dtype=torch.float64)
        for step in range(2000):
            total += torch.bincount(stratified(geometry, density, 20, generator_at(5, step)).face, minlength=80)
        # Every count is 0 or 1, so its variance is at most its mean.
        expected = 2000 * 20 * density.double() / density.double().sum()
        assert float(((total - expected).abs() / expected.sqrt()).max()) < 5

    def test_even_inside_faces(self) -> None:
        geometry = small_geometry()
        base = stratified(geometry, geometry.areas, 40_000, generator_at(0, 0))
        assert p_value(base, cell_shares(geometry, affine_parameters(geometry))) > 1e-3

    def test_sorted_by_face(self) -> None:
        geometry = small_geometry()
        face = stratified(geometry, geometry.areas, 500, generator_at(0, 0)).face
        assert torch.equal(face, face.sort().values)


class TestRejection:
    @pytest.mark.parametrize("name", ["linear", "random"])
    def test_chi_square_against_the_jacobian(self, name: str) -> None:
        geometry = small_geometry()
        linear = np.diag([2.0, 1.0, 0.5])
        parameters = affine_parameters(geometry, linear) if name == "linear" else smooth_field(geometry)
        shares = cell_shares(geometry, parameters)
        base = by_rejection(geometry, parameters, 40_000, generator_at(0, 0))
        assert len(base.face) == 40_000
        even = stratified(geometry, geometry.areas, 40_000, generator_at(0, 0))
        assert p_value(even, shares) < 1e-6, "the test could not tell"
        assert p_value(base, shares) > 1e-3

    @pytest.mark.parametrize("count", [1, 100, 9000])
    def test_as_many_as_asked_sorted_by_face(self, count: int) -> None:
        geometry = small_geometry()
        face = by_rejection(geometry, smooth_field(geometry), count, generator_at(0, 0)).face
        assert len(face) == count
        assert torch.equal(face, face.sort().values)

    @pytest.mark.parametrize("value", [0.0, float("nan")])
    def test_without_area_there_is_an_end(self, value: float) -> None:
        geometry = small_geometry()
        parameters = affine_parameters(geometry, np.zeros((3, 3)))
        parameters.views["forward.bias.1"].fill_(value)
        if value:
            parameters.flat.fill_(value)
        with pytest.raises(FitError, match="no area or is not finite"):
            by_rejection(geometry, parameters, 10, generator_at(0, 0))


class TestSeedAndStep:
    @pytest.mark.parametrize("way", ["stratified", "rejection"])
    def test_draws_depend_on_nothing_else(self, way: str) -> None:
        geometry = small_geometry()
        parameters = smooth_field(geometry)

        def draw(seed: int, step: int) -> Tensor:
            generator = generator_at(seed, step)
            if way == "rejection":
                return by_rejection(geometry, parameters, 50, generator).barycentric
            return stratified(geometry, geometry.areas, 50, generator).barycentric

        first = draw(3, 8)
        torch.manual_seed(99)
        before = torch.get_rng_state()
        draw(3, 9)
        assert torch.equal(draw(3, 8), first)
        assert torch.equal(torch.get_rng_state(), before)
        assert not torch.equal(draw(3, 9), first)
        assert not torch.equal(draw(4, 8), first)

    def test_streams_are_distinct(self) -> None:
        steps = [-1000, -2, -1, 0, 1, 2, 49, 50, 10_000, 2**40, 2**40 + 1]
        seeds = [0, 1, 2, 2**31, 2**63 - 1]
        firsts = {int(torch.randint(2**62, (1,), generator=generator_at(s, k))) for s in seeds for k in steps}
        assert len(firsts) == len(steps) * len(seeds)


def test_points_lie_where_their_weights_say() -> None:
    geometry = small_geometry()
    base = stratified(geometry, geometry.areas, 300, generator_at(0, 0))
    assert float(base.barycentric.min()) >= 0
    torch.testing.assert_close(base.barycentric.sum(1), torch.ones(300))
    corners = geometry.vertices[geometry.faces[base.face]]
    expected = torch.einsum("nc,ncx->nx", base.barycentric, corners)
    torch.testing.assert_close(base.batch.positions, expected)
    part = base.rows(10, 30)
    assert torch.equal(part.face, base.face[10:30])
    assert torch.equal(part.batch.positions, base.batch.positions[10:30])
    assert base.rows(0, 300) is base


def test_mapped_areas_approach_the_integral_of_the_jacobian() -> None:
    geometry = small_geometry()
    parameters = random_parameters(geometry, levels=0, size=0.3)
    by_cells = cell_shares(geometry, parameters).view(len(geometry.faces), -1).sum(1)
    areas = mapped_areas(geometry, parameters).double()
    assert float((areas / areas.sum() - by_cells).abs().max()) < 0.05 * float(by_cells.max())

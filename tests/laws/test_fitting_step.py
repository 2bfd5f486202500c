"""The hand-written step gives what autograd gives through the readable networks."""

from __future__ import annotations

import pytest
import torch
from small_surfaces import base_points, doubled, random_parameters, small_geometry
from torch import Tensor

from ndf_core.fitting.network import Parameters, displace, interpolate, invert
from ndf_core.fitting.sampling import BasePoints
from ndf_core.fitting.step import Batch, FusedStep, tile_size
from ndf_core.fitting.trainer import row_slices

ROWS = 103
CASES = {
    "plain": {},
    "no features": {"feature_dim": 0},
    "no waves": {"levels": 0},
    "neither": {"levels": 0, "feature_dim": 0},
    "shallow": {"hidden_layers": 1},
    "deep": {"hidden_layers": 3},
    "eight octaves": {"levels": 8, "width": 40, "feature_dim": 7},
}


def setting(**options: int) -> tuple[Parameters, Batch]:
    geometry = small_geometry()
    return random_parameters(geometry, **options), BasePoints(geometry, *base_points(geometry, ROWS)).batch


def exactly(parameters: Parameters, batch: Batch) -> tuple[Parameters, Tensor, Tensor, Tensor, Tensor]:
    """Live float64 parameters, base points, their images and those of the inverse, and the images before rounding."""
    live = Parameters(parameters.shape, doubled(parameters).flat.requires_grad_())
    positions, barycentric = batch.positions.double(), batch.barycentric.double()
    mapped = displace(live, positions, interpolate(live.features, batch.corners, barycentric))
    return live, positions, mapped, invert(live, mapped), invert(live, positions)


def assert_same_gradient(found: Parameters, live: Parameters, total: Tensor) -> None:
    (flat,) = torch.autograd.grad(total, live.flat)
    expected = Parameters(found.shape, flat)
    for name, view in found.views.items():
        wanted = expected.views[name]
        # Rounding of float32 grows with the frequencies; anything wrong is off by the size of the gradient itself.
        torch.testing.assert_close(
            view.double(), wanted, rtol=2e-4, atol=2e-5 * float(wanted.abs().max()) if wanted.numel() else 0.0
        )


@pytest.mark.parametrize("stride", [1, 3, 500])
@pytest.mark.parametrize("options", CASES.values(), ids=CASES)
def test_value_and_gradient_equal_autograd(options: dict[str, int], stride: int) -> None:
    parameters, batch = setting(**options)
    turn = 2
    upstream = torch.randn(ROWS, 3, generator=torch.Generator().manual_seed(1))
    fused = FusedStep(parameters.shape, ROWS, stride)
    mapped = fused.map(parameters, batch).clone()
    loss = fused.backward(parameters, batch, upstream.clone(), 7.0, turn)

    live, positions, exact, back, _ = exactly(parameters, batch)
    stride = min(stride, ROWS)
    count = ROWS // stride
    rows = [turn % (ROWS - (count - 1) * stride) + i * stride for i in range(count)]
    cycle = (back - positions).square().sum(1)[rows].mean()
    torch.testing.assert_close(mapped.double(), exact.detach(), rtol=0, atol=1e-6)
    torch.testing.assert_close(loss.double(), cycle.detach(), rtol=1e-4, atol=0)
    assert_same_gradient(fused.gradient, live, (upstream.double() * exact).sum() + 7.0 * cycle)


@pytest.mark.parametrize("options", CASES.values(), ids=CASES)
def test_identity_gradient_equals_autograd(options: dict[str, int]) -> None:
    parameters, batch = setting(**options)
    fused = FusedStep(parameters.shape, ROWS, 1)
    fused.identity(parameters, batch, 0.5)
    live, positions, mapped, _, back = exactly(parameters, batch)
    total = (mapped - positions).square().sum(1).mean() + (back - positions).square().sum(1).mean()
    assert_same_gradient(fused.gradient, live, 0.5 * total)


def test_gradients_add_up() -> None:
    parameters, batch = setting()
    fused = FusedStep(parameters.shape, ROWS, 1)
    for expected in (1.0, 2.0):
        fused.map(parameters, batch)
        fused.backward(parameters, batch, torch.zeros(ROWS, 3), 1.0)
        if expected == 1.0:
            once = fused.gradient.flat.clone()
    torch.testing.assert_close(fused.gradient.flat, 2 * once)


@pytest.mark.parametrize(("workers", "tile"), [(1, 40), (3, 1000), (2, 20)])
def test_tiles_add_up_to_the_whole(workers: int, tile: int) -> None:
    parameters, batch = setting()
    upstream = torch.randn(ROWS, 3, generator=torch.Generator().manual_seed(1))

    def step(rows: slice, gradient: Parameters) -> float:
        part = Batch(*(tensor[rows] for tensor in batch))
        share = len(part.positions) / ROWS
        fused = FusedStep(parameters.shape, len(part.positions), 1, gradient=gradient)
        fused.map(parameters, part)
        return share * float(fused.backward(parameters, part, upstream[rows].clone(), share))

    whole, parts = Parameters.zeros(parameters.shape), Parameters.zeros(parameters.shape)
    loss = step(slice(0, ROWS), whole)
    slices = [rows for worker in row_slices(ROWS, workers, tile) for rows in worker]
    assert sum(step(rows, parts) for rows in slices) == pytest.approx(loss, rel=1e-5)
    torch.testing.assert_close(parts.flat, whole.flat, rtol=1e-4, atol=1e-5 * float(whole.flat.abs().max()))


@pytest.mark.parametrize("batch", [1, 2, 4, 11, 12])
@pytest.mark.parametrize("stride", [1, 3, 4, 50])
def test_every_row_has_its_turn_in_the_cycle_loss(batch: int, stride: int) -> None:
    geometry = small_geometry()
    parameters = random_parameters(geometry)
    base = BasePoints(geometry, *base_points(geometry, batch)).batch
    fused = FusedStep(parameters.shape, batch, stride)
    reached = torch.zeros(batch, dtype=torch.bool)
    for turn in range(2 * stride):
        upstream = torch.zeros(batch, 3)
        fused.map(parameters, base)
        fused.backward(parameters, base, upstream, 1.0, turn)
        assert int(upstream.any(dim=1).sum()) == max(1, batch // stride)
        reached |= upstream.any(dim=1)
    assert reached.all()


def test_tiles_fit_the_cache_on_the_cpu_alone() -> None:
    assert tile_size(100, "cpu") == 100
    assert tile_size(10**6, "cpu") < 10**5
    assert tile_size(10**6, "cuda") == 10**6


@pytest.mark.parametrize("batch", [1, 7, 100])
@pytest.mark.parametrize("workers", [1, 2, 3, 8])
@pytest.mark.parametrize("tile", [30, 1000])
def test_rows_are_shared_out_evenly(batch: int, workers: int, tile: int) -> None:
    slices = row_slices(batch, workers, tile)
    assert sorted(row for worker in slices for part in worker for row in range(batch)[part]) == list(range(batch))
    sizes = [part.stop - part.start for worker in slices for part in worker]
    assert max(sizes) <= tile and max(sizes) - min(sizes) <= 1 and min(sizes) >= 1
    assert len(slices) == min(workers, batch) and len({len(worker) for worker in slices}) == 1

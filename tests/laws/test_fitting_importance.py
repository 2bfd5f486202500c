"""Samples go where the error is, and their weights undo it."""

from __future__ import annotations

import pytest
import torch
from small_surfaces import small_geometry
from torch import Tensor

from ndf_core.fitting.importance import FaceErrors
from ndf_core.fitting.sampling import generator_at, joined, stratified

SHARE = 0.9


def errors_of(squared: Tensor, samples: int = 200) -> FaceErrors:
    """Every face seen `samples` times in one step, always at the same squared distance."""
    errors = FaceErrors(len(squared), "cpu")
    face = torch.arange(len(squared)).repeat_interleave(samples)
    errors.add(face, squared[face], torch.ones(len(face), dtype=torch.bool))
    return errors


def uneven(count: int) -> Tensor:
    """Squared distances over three orders of magnitude."""
    return torch.logspace(-3, 0, count)[torch.randperm(count, generator=torch.Generator().manual_seed(4))]


class TestDensity:
    def test_mean_over_the_area_is_one_and_no_face_goes_without(self) -> None:
        areas = small_geometry().areas
        density = errors_of(uneven(len(areas))).density(areas, SHARE)
        assert float((areas * density).sum() / areas.sum()) == pytest.approx(1, rel=1e-5)
        assert float(density.min()) >= 1 - SHARE

    def test_grows_with_the_distance(self) -> None:
        areas = torch.ones(2)
        density = errors_of(torch.tensor([1.0, 9.0]), samples=10_000).density(areas, 0.5)
        torch.testing.assert_close(density, torch.tensor([0.5 + 0.25, 0.5 + 0.75]), rtol=1e-3, atol=0)

    @pytest.mark.parametrize("squared", [0.0, None], ids=["an exact fit", "nothing seen"])
    def test_even_where_nothing_says_otherwise(self, squared: float | None) -> None:
        areas = torch.rand(8) + 0.1
        errors = FaceErrors(8, "cpu") if squared is None else errors_of(torch.full((8,), squared))
        assert torch.equal(errors.density(areas, SHARE), torch.ones(8))

    def test_few_samples_say_little(self) -> None:
        squared = torch.tensor([1.0, 100.0])
        areas = torch.ones(2)
        few, many = (errors_of(squared, n).density(areas, SHARE) for n in (1, 1000))
        assert float(few[1] - few[0]) < float(many[1] - many[0])

    def test_what_is_not_known_does_not_count(self) -> None:
        errors = FaceErrors(2, "cpu")
        errors.add(torch.tensor([0, 0, 1]), torch.tensor([4.0, 1e9, 4.0]), torch.tensor([True, False, True]))
        torch.testing.assert_close(errors.density(torch.ones(2), SHARE), torch.ones(2))

    def test_old_samples_are_forgotten(self) -> None:
        errors = errors_of(torch.tensor([1.0, 100.0]))
        for _ in range(300):
            errors.add(torch.tensor([0, 1]), torch.tensor([4.0, 4.0]), torch.tensor([True, True]))
        torch.testing.assert_close(errors.density(torch.ones(2), SHARE), torch.ones(2), rtol=1e-2, atol=0)

    def test_state_is_all_there_is(self) -> None:
        areas = small_geometry().areas
        errors, other = errors_of(uneven(len(areas))), FaceErrors(len(areas), "cpu")
        other.load_state({name: tensor.clone() for name, tensor in errors.state.items()})
        assert torch.equal(errors.density(areas, SHARE), other.density(areas, SHARE))


class TestWeights:
    def estimates(self, share: float) -> tuple[Tensor, float]:
        """Of the area's mean of |error|, which is how large the loss's gradient is: 400 of them, and the truth."""
        geometry = small_geometry()
        length = uneven(len(geometry.faces)).sqrt()
        density = errors_of(length**2).density(geometry.areas, share) if share else None
        found: list[Tensor] = []
        for step in range(400):
            base = stratified(geometry, geometry.areas, 40, generator_at(2, step), density)
            weight = torch.ones(40) if base.weight is None else base.weight
            # A sample's gradient points anywhere, so it is what the noise is made of.
            sign = torch.randint(0, 2, (40,), generator=generator_at(3, step)) * 2.0 - 1
            found.append(
                torch.stack([(length[base.face] * weight).mean(), (length[base.face] * weight * sign).mean()])
            )
        return torch.stack(found), float((length * geometry.areas).sum() / geometry.areas.sum())

    def test_leave_the_mean_where_it_is(self) -> None:
        found, truth = self.estimates(SHARE)
        error = found[:, 0].std() / 400**0.5
        assert abs(float(found[:, 0].mean()) - truth) < 4 * float(error) + 1e-6

    def test_take_noise_away(self) -> None:
        even, drawn = self.estimates(0.0)[0][:, 1].var(), self.estimates(SHARE)[0][:, 1].var()
        assert float(drawn) < 0.8 * float(even)

    def test_follow_their_rows(self) -> None:
        geometry = small_geometry()
        density = errors_of(uneven(len(geometry.faces))).density(geometry.areas, SHARE)
        drawn = stratified(geometry, geometry.areas, 30, generator_at(0, 0), density)
        plain = stratified(geometry, geometry.areas, 10, generator_at(0, 1))
        assert drawn.weight is not None and plain.weight is None
        torch.testing.assert_close(drawn.weight, 1 / density[drawn.face])
        whole = joined(drawn, plain)
        assert whole.weight is not None
        assert torch.equal(whole.weight, torch.cat([drawn.weight, torch.ones(10)]))
        part = whole.rows(25, 35).weight
        assert part is not None
        assert torch.equal(part, whole.weight[25:35])
        assert torch.equal(whole.batch.positions, torch.cat([drawn.batch.positions, plain.batch.positions]))

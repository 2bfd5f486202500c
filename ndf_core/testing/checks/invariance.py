"""Laws that compare two calls of a `Projector`, or two surfaces."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ndf_core.interfaces import Projection
from ndf_core.testing.check import NotAsked, expect, law
from ndf_core.testing.checks.projector import projector_answers, projector_reaches_the_surface
from ndf_core.testing.motion import RIGID_MOTIONS, SCALING, Motion
from ndf_core.testing.subject import POINTS, Subject

_EXACT = 5e-7
"""Differences that rounding explains, also in single precision, as a share of the longest side."""
_STRAYS = 0.01
"""Share of rows that may land elsewhere, where a law is within tolerance: there are points with two closest ones."""


@law(projector_answers)
def projector_is_pure(subject: Subject) -> None:
    """A resumed run must see what the uninterrupted one saw: nothing is kept between calls."""
    again = subject.project(subject.queries, subject.directions)
    _expect_same(subject, again, "asked twice, the projector gives two answers")


@law(projector_is_pure, projector_reaches_the_surface)
def projecting_twice_is_projecting_once(subject: Subject) -> None:
    """What it calls the surface has to be a surface to itself."""
    answer = subject.answer
    twice = subject.project(answer.points, subject.directions)
    both = answer.converged & twice.converged
    lost = float((answer.converged & ~twice.converged).double().mean())
    expect(lost <= _STRAYS, f"{lost:.0%} of the projections do not converge when they are projected again")
    _expect_close(subject, twice.points[both], answer.points[both], "projections move when they are projected again")


@law(projector_is_pure, projector_reaches_the_surface)
def points_on_the_surface_stay(subject: Subject) -> None:
    """Or the field is drawn to another surface than the input's."""
    if subject.surface.sample is None:
        raise NotAsked("the surface cannot be sampled")
    points, normals = subject.surface.sample(POINTS, np.random.default_rng(2))
    if subject.surface.projector.needs_directions and normals is None:
        raise NotAsked("the projector needs directions, and samples of the surface have none")
    queries = torch.from_numpy(np.ascontiguousarray(points, np.float64))
    directions = queries if normals is None else torch.from_numpy(np.ascontiguousarray(normals, np.float64))
    answer = subject.project(queries, directions)
    there = answer.converged
    _expect_close(subject, answer.points[there], queries[there], "points of the surface move")


@law(projector_is_pure)
def batches_do_not_matter(subject: Subject) -> None:
    """Rows are independent: batches are cut by memory and threads."""
    half = POINTS // 2
    parts = [
        subject.project(subject.queries[rows], subject.directions[rows]) for rows in (slice(half), slice(half, None))
    ]
    _expect_same(subject, _joined(parts), "two halves projected one after another are not the whole")


@law(projector_is_pure)
def order_does_not_matter(subject: Subject) -> None:
    """Rows are independent: samples come in any order."""
    order = torch.from_numpy(np.random.default_rng(3).permutation(POINTS))
    shuffled = subject.project(subject.queries[order], subject.directions[order])
    back = torch.argsort(order)
    normals = None if shuffled.normals is None else shuffled.normals[back]
    restored = Projection(shuffled.points[back], shuffled.converged[back], normals)
    _expect_same(subject, restored, "shuffled rows give other answers")


@law(projector_is_pure, projector_reaches_the_surface)
def projector_follows_rigid_motion(subject: Subject) -> None:
    """A surface has no favourite directions and no favourite place."""
    _follow(subject, RIGID_MOTIONS)


@law(projector_is_pure, projector_reaches_the_surface)
def projector_follows_scale(subject: Subject) -> None:
    """Millimetres and metres are the same surface: tolerances are shares of its size."""
    _follow(subject, (SCALING,))


def _follow(subject: Subject, motions: Iterable[Motion]) -> None:
    if subject.moved is None:
        raise NotAsked("nobody said how to move the source (`moved`)")
    for motion in motions:
        source = subject.moved(subject.source, motion, subject.folder)
        if source is not None:
            break
    else:
        raise NotAsked("the format cannot express the motion")
    surface = subject.opened(source)
    queries = torch.from_numpy(motion.apply(subject.queries.numpy()))
    directions = torch.from_numpy(np.ascontiguousarray(motion.turn(subject.directions.numpy())))
    found = subject.project(queries, directions, surface)
    both = subject.answer.converged & found.converged
    agree = float((subject.answer.converged == found.converged).double().mean())
    expect(agree >= 1 - 2 * _STRAYS, f"{motion.name}, {1 - agree:.0%} of the rows converge or not as before")
    expected = torch.from_numpy(motion.apply(subject.answer.points.numpy()))
    what = f"the surface {motion.name}, projections do not follow"
    _expect_close(subject, found.points[both] / motion.scale, expected[both] / motion.scale, what)


def _joined(parts: list[Projection]) -> Projection:
    normals = [part.normals for part in parts if part.normals is not None]
    return Projection(
        torch.cat([part.points for part in parts]),
        torch.cat([part.converged for part in parts]),
        torch.cat(normals) if len(normals) == len(parts) else None,
    )


def _expect_same(subject: Subject, found: Projection, what: str) -> None:
    """But for rounding."""
    answer = subject.answer
    expect(torch.equal(found.converged, answer.converged), f"{what}: rows converge in one case and not in the other")
    distance = _distances(subject, found.points, answer.points)
    expect(bool((distance <= _EXACT).all()), f"{what}: by up to {float(distance.max()):.1e} of the longest side")


def _expect_close(subject: Subject, found: Float[Tensor, "n 3"], wanted: Float[Tensor, "n 3"], what: str) -> None:
    """Within the tolerance of the representation."""
    expect(len(found) > 0, f"{what}: no row converges in both cases")
    distance = _distances(subject, found, wanted)
    off: Bool[Tensor, " n"] = distance > subject.tolerance
    share = float(off.double().mean())
    expect(
        share <= _STRAYS,
        f"{what}: {share:.0%} by more than {subject.tolerance:g} of the longest side, the median by "
        f"{float(distance.median()):.1e}",
    )


def _distances(subject: Subject, found: Float[Tensor, "n 3"], wanted: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """In longest sides; not a number counts as infinitely far."""
    distance = torch.linalg.vector_norm(found - wanted, dim=1) / subject.size
    return torch.nan_to_num(distance, nan=torch.inf, posinf=torch.inf)

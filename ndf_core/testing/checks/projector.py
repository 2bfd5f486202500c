"""Laws of one call of a `Projector`."""

from __future__ import annotations

import math

import torch

from ndf_core.errors import InputError
from ndf_core.interfaces import Projection
from ndf_core.testing.check import Broken, NotAsked, expect, law
from ndf_core.testing.checks.base_mesh import base_mesh_has_no_flat_faces, base_mesh_is_oriented
from ndf_core.testing.subject import Subject

_ENOUGH = 0.5
"""Share of the points near the base mesh that have to converge."""
_OUTWARDS = 0.75
"""Share of the normals that have to point to the base mesh's outside: thin parts are short of faces there."""
_BEYOND = 0.25
"""Converged points may lie so many longest sides beyond the base mesh."""


@law(base_mesh_is_oriented, base_mesh_has_no_flat_faces)
def projector_answers(subject: Subject) -> None:
    """The trainer counts on one row for each query."""
    answer, count = subject.answer, len(subject.queries)
    expect(tuple(answer.points.shape) == (count, 3), f"{count} queries give points {tuple(answer.points.shape)}")
    expect(tuple(answer.converged.shape) == (count,), f"{count} queries give flags {tuple(answer.converged.shape)}")
    expect(answer.converged.dtype == torch.bool, f"the flags are {answer.converged.dtype}, not bool")
    normals = answer.normals
    fits = normals is None or tuple(normals.shape) == (count, 3)
    expect(fits, "normals must be one for each query, or None")


@law(projector_answers)
def projector_reaches_the_surface(subject: Subject) -> None:
    """Rows that do not converge teach nothing; a fit with too few of the others stops."""
    share = float(subject.answer.converged.double().mean())
    expect(share >= _ENOUGH, f"only {share:.0%} of the points near the base mesh converge")


@law(projector_answers)
def projector_keeps_type_and_device(subject: Subject) -> None:
    """Losses are computed in the precision and on the device of the samples."""
    devices = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    for device in devices:
        for dtype in (torch.float64, torch.float32):
            queries, directions = (part.to(device, dtype) for part in (subject.queries, subject.directions))
            answer = subject.project(queries, directions)
            parts = [answer.points, *([] if answer.normals is None else [answer.normals])]
            for part in parts:
                expect(part.dtype == dtype, f"queries of {dtype} give an answer of {part.dtype}")
            for part in (*parts, answer.converged):
                expect(part.device.type == device, f"queries on {device} give an answer on {part.device.type}")


@law(projector_answers)
def projector_takes_no_points(subject: Subject) -> None:
    """The last batch may be empty."""
    answer = subject.project(subject.queries[:0], subject.directions[:0])
    expect(tuple(answer.points.shape) == (0, 3), f"no queries give points {tuple(answer.points.shape)}")
    expect(tuple(answer.converged.shape) == (0,), f"no queries give flags {tuple(answer.converged.shape)}")


@law(projector_answers)
def projector_leaves_its_input_alone(subject: Subject) -> None:
    """The queries are the mapped points that the losses go on with."""
    queries, directions = subject.queries.clone(), subject.directions.clone()
    projector = subject.surface.projector
    projector.project(queries, directions if projector.needs_directions else None)
    same = torch.equal(queries, subject.queries) and torch.equal(directions, subject.directions)
    expect(same, "projecting changes the query points in place")


@law(projector_answers)
def projector_refuses_nan(subject: Subject) -> None:
    """A field that has blown up has to be seen at once: InputError."""
    for value in (math.nan, math.inf):
        queries = subject.queries.clone()
        queries[3, 1] = value
        try:
            subject.project(queries, subject.directions)
        except InputError:
            continue
        except Exception as error:
            raise Broken(f"a coordinate that is {value} must be an InputError, not {type(error).__name__}") from error
        raise Broken(f"a coordinate that is {value} is projected as if it were a number")


@law(projector_answers)
def far_points_stay_finite(subject: Subject) -> None:
    """A NaN of one row, flagged or not, would spread to every parameter."""
    answer = _far(subject)
    expect(bool(answer.points.isfinite().all()), "points far away have projections that are not finite")
    finite = answer.normals is None or bool(answer.normals.isfinite().all())
    expect(finite, "points far away have normals that are not finite")


@law(projector_answers)
def far_points_are_flagged(subject: Subject) -> None:
    """Rows that did not get to the surface must say so, or they drag the field away."""
    answer = _far(subject)
    vertices = torch.from_numpy(subject.base_mesh.vertices)
    room = _BEYOND * subject.size
    found = answer.points[answer.converged]
    beyond = ((found < vertices.amin(0) - room) | (found > vertices.amax(0) + room)).any(dim=1)
    expect(not bool(beyond.any()), f"{int(beyond.sum())} rows claim to have converged, far from the base mesh")


@law(projector_reaches_the_surface)
def normals_are_unit(subject: Subject) -> None:
    """The loss of normals compares directions."""
    answer = subject.answer
    if answer.normals is None:
        raise NotAsked("the projector gives no normals")
    lengths = torch.linalg.vector_norm(answer.normals[answer.converged], dim=1)
    off = ((lengths - 1).abs() > 1e-3).double().mean()
    expect(float(off) <= 0.01, f"{float(off):.0%} of the normals are not of length 1")


@law(projector_reaches_the_surface)
def normals_point_outwards(subject: Subject) -> None:
    """Folds are told by n_theta . n_surface: normals that point inwards turn the field inside out."""
    answer = subject.answer
    if answer.normals is None:
        raise NotAsked("the projector gives no normals")
    outwards = (answer.normals * subject.directions).sum(dim=1)[answer.converged] > 0
    share = float(outwards.double().mean())
    expect(share >= _OUTWARDS, f"only {share:.0%} of the normals point to the base mesh's outside")


def _far(subject: Subject) -> Projection:
    return subject.project(*subject.far_queries)

"""Laws of `BaseMeshExtractor`."""

from __future__ import annotations

import numpy as np

from ndf_core.base_mesh.checks import MIN_ALTITUDE, altitudes, inside_out_components
from ndf_core.mesh import Topology, topology
from ndf_core.testing.check import NotAsked, expect, law
from ndf_core.testing.checks.opening import source_can_be_opened
from ndf_core.testing.subject import Subject

OPEN = "open"
"""Kind of the remark that declares a base mesh with a boundary."""


@law(source_can_be_opened)
def base_mesh_can_be_made(subject: Subject) -> None:
    """There is no fit without one."""
    _ = subject.base_mesh


@law(base_mesh_can_be_made)
def base_mesh_is_finite(subject: Subject) -> None:
    """Everything is computed on it."""
    mesh = subject.base_mesh
    expect(len(mesh.vertices) > 0 and len(mesh.faces) > 0, "it is empty")
    expect(bool(np.isfinite(mesh.vertices).all()), "it has vertices that are not finite")
    in_range = mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)
    expect(bool(in_range), "a face names a vertex that does not exist")


@law(base_mesh_is_finite)
def base_mesh_is_closed(subject: Subject) -> None:
    """Extracted meshes have the topology of the base mesh; one with a boundary has to say so in a remark."""
    declared = any(remark.kind == OPEN for remark in subject.base_mesh.remarks)
    edges = _counts(subject).boundary_edges
    expect(declared or not edges, f"{edges} edges have one face, and no remark of kind {OPEN!r} says why")


@law(base_mesh_is_finite)
def base_mesh_is_manifold(subject: Subject) -> None:
    """The map from the base mesh is one-to-one only where its neighbourhoods are discs."""
    counts = _counts(subject)
    faults = {
        "edges with more than two faces": counts.non_manifold_edges,
        "vertices with several fans": counts.non_manifold_vertices,
        "faces that name a vertex twice": counts.degenerate_faces,
        "vertices without a face": counts.unused_vertices,
    }
    found = ", ".join(f"{count} {what}" for what, count in faults.items() if count)
    expect(not found, f"it has {found}")


@law(base_mesh_is_manifold)
def base_mesh_is_oriented(subject: Subject) -> None:
    """Outside is where its normals point: samples, folds and normals are judged by that."""
    counts, mesh = _counts(subject), subject.base_mesh
    expect(not counts.inconsistent_edges, f"{counts.inconsistent_edges} edges lie between oppositely oriented faces")
    if counts.closed:
        wrong = len(inside_out_components(mesh.vertices, mesh.faces))
        expect(not wrong, f"{wrong} of its components are inside out")


@law(base_mesh_is_manifold)
def base_mesh_has_no_flat_faces(subject: Subject) -> None:
    """A face without area has no normal, and no point of it can be sampled."""
    mesh = subject.base_mesh
    flat = int((altitudes(mesh.vertices, mesh.faces) < MIN_ALTITUDE * subject.size).sum())
    expect(not flat, f"{flat} faces have no area")


@law(base_mesh_is_finite)
def base_mesh_has_few_faces(subject: Subject) -> None:
    """--faces is a promise about the asset's size; a remark of kind "faces_not_reached" says why it is broken."""
    declared = any(remark.kind == "faces_not_reached" for remark in subject.base_mesh.remarks)
    count = len(subject.base_mesh.faces)
    expect(declared or count <= subject.faces, f"it has {count} faces, {subject.faces} were asked for")


@law(base_mesh_is_finite)
def base_mesh_is_repeatable(subject: Subject) -> None:
    """A resumed run and a second machine need the same base mesh for the same seed."""
    mesh, again = subject.base_mesh, subject.surface_again.base_mesh.extract(subject.faces)
    same = np.array_equal(mesh.vertices, again.vertices) and np.array_equal(mesh.faces, again.faces)
    expect(same, "extracted twice with the same seed, it is not the same")


@law(base_mesh_is_finite)
def base_mesh_stays_in_bounds(subject: Subject) -> None:
    """Samples start on it: parts far from the surface have nowhere to go."""
    if subject.surface.sample is None:
        raise NotAsked("the surface cannot be sampled")
    points = subject.surface.sample(1000, np.random.default_rng(0))[0]
    margin = 0.1 * float(np.ptp(points, axis=0).max())
    vertices = subject.base_mesh.vertices
    beyond = ((vertices < points.min(axis=0) - margin) | (vertices > points.max(axis=0) + margin)).any(axis=1)
    expect(not beyond.any(), f"{int(beyond.sum())} vertices lie more than 10% beyond the samples of the surface")


def _counts(subject: Subject) -> Topology:
    return topology(subject.base_mesh.faces, len(subject.base_mesh.vertices))

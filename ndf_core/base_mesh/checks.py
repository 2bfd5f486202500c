"""What every base mesh must satisfy, checked and not assumed."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.errors import BaseMeshError
from ndf_core.interfaces import BaseMesh
from ndf_core.mesh import Topology, face_components, face_normals, topology

MIN_ALTITUDE = 1e-9
"""A triangle is degenerate when its smallest altitude is below this share of the longest side."""


def check_base_mesh(
    mesh: BaseMesh,
    *,
    closed: bool = True,
    euler_characteristic: int | None = None,
    components: int | None = None,
) -> Topology:
    """Raise unless `mesh` is finite, manifold (edges and vertices), oriented outwards and free of degenerate faces.

    Args:
        mesh: The mesh to check, in any units.
        closed: Whether it must have no boundary. With a boundary, "outwards" means nothing and is not checked.
        euler_characteristic: What it must be, where it is known.
        components: The same for the number of components.

    Returns:
        The counts that were checked.

    Raises:
        BaseMeshError: with every condition that does not hold, in numbers.
    """
    faults = _array_faults(mesh)
    if faults:
        raise BaseMeshError("the base mesh is not usable: " + "; ".join(faults))
    counts = topology(mesh.faces, len(mesh.vertices))
    if not counts.manifold:
        faults.append(_manifold_fault(counts))
    if closed and not counts.closed:
        faults.append(f"it has {counts.boundary_edges} boundary edges and must be closed")
    for name, have, want in (
        ("Euler characteristic", counts.euler_characteristic, euler_characteristic),
        ("number of components", counts.components, components),
    ):
        if want is not None and have != want:
            faults.append(f"its {name} is {have}, that of the surface it was made from {want}")
    thin = int((altitudes(mesh.vertices, mesh.faces) < MIN_ALTITUDE * longest_side(mesh.vertices)).sum())
    if thin:
        faults.append(f"{thin} faces have no area")
    if not faults and closed:
        faults += _orientation_faults(mesh)
    if faults:
        raise BaseMeshError("the base mesh is not usable: " + "; ".join(faults))
    return counts


def longest_side(vertices: Float[Array, "v 3"]) -> float:
    """Longest side of the bounding box, in the vertices' units."""
    return float((vertices.max(axis=0) - vertices.min(axis=0)).max())


def altitudes(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, " f"]:
    """Smallest altitude of each triangle, in the vertices' units; 0 for a point."""
    corners = vertices[faces]
    longest = np.sqrt(((corners - np.roll(corners, -1, axis=1)) ** 2).sum(axis=2).max(axis=1))
    area = np.linalg.norm(face_normals(vertices, faces), axis=1)
    return np.divide(area, longest, out=np.zeros_like(area), where=longest > 0)


def component_volumes(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, " c"]:
    """Signed volume of each component, in the order of `ndf_core.mesh.face_components`."""
    label = face_components(faces, len(vertices))
    _, first = np.unique(label, return_index=True)
    # About a vertex of the component itself, for precision far from the origin.
    a, b, c = (vertices[faces[:, i]] - vertices[faces[first, 0]][label] for i in range(3))
    return np.bincount(label, weights=np.einsum("ij,ij->i", a, np.cross(b, c))) / 6.0


def winding_number(point: Float[Array, "3"], vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> float:
    """Solid angle of the mesh seen from `point`, over 4 pi, by direct summation (van Oosterom and Strackee 1983)."""
    a, b, c = (vertices[faces[:, i]] - point for i in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
    denominator = (
        la * lb * lc
        + np.einsum("ij,ij->i", a, b) * lc
        + np.einsum("ij,ij->i", b, c) * la
        + np.einsum("ij,ij->i", c, a) * lb
    )
    return float(np.arctan2(numerator, denominator).sum() / (2 * np.pi))


def inside_out_components(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Int[Array, " k"]:
    """Labels (as `face_components` numbers them) of closed components whose normals point the wrong way.

    A component with negative volume is right if it bounds a cavity, that is if it lies inside the rest.
    """
    label = face_components(faces, len(vertices))
    wrong: list[int] = []
    for index in np.flatnonzero(component_volumes(vertices, faces) <= 0):
        mine = label == index
        if mine.all() or winding_number(vertices[faces[mine][0, 0]], vertices, faces[~mine]) < 0.5:
            wrong.append(int(index))
    return np.array(wrong, dtype=np.int64)


def _array_faults(mesh: BaseMesh) -> list[str]:
    if not len(mesh.faces) or not len(mesh.vertices):
        return ["it is empty"]
    if not np.isfinite(mesh.vertices).all():
        return [f"{int((~np.isfinite(mesh.vertices)).any(axis=1).sum())} vertices are not finite"]
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        return ["a face names a vertex that does not exist"]
    return []


def _manifold_fault(counts: Topology) -> str:
    parts = {
        "non-manifold edges": counts.non_manifold_edges,
        "non-manifold vertices": counts.non_manifold_vertices,
        "edges between oppositely oriented faces": counts.inconsistent_edges,
        "faces that name a vertex twice": counts.degenerate_faces,
        "unused vertices": counts.unused_vertices,
    }
    return "it has " + ", ".join(f"{count} {name}" for name, count in parts.items() if count)


def _orientation_faults(mesh: BaseMesh) -> list[str]:
    wrong = inside_out_components(mesh.vertices, mesh.faces)
    return [f"{len(wrong)} of its components are inside out"] if len(wrong) else []

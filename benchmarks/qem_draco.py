"""The baseline of `rate_distortion.py`: a mesh decimated by quadric error and coded by Draco, as good as it gets.

Every combination of face count, decimator and bits is coded, decoded and measured in both directions; what counts is
the lower envelope of all of them. Vertices are not optimised after decimation: this is plain QEM + Draco.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.decimate import decimate
from ndf_core.mesh import face_normals

Mesh = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]

FACES = tuple(round(500 * 2 ** (step / 2)) for step in range(15))
"""500 to 64,000; a shape with fewer is coded itself instead."""
BITS = tuple(range(8, 15))
SEED = 77_003


def _plain(vertices: Array, faces: Array, count: int) -> Mesh:
    return decimate(vertices, faces, count, regularisation=0.0, shape=0.0, altitude=0.0)[:2]


def _even(vertices: Array, faces: Array, count: int) -> Mesh:
    """Slightly evener triangles cost Draco fewer bytes."""
    return decimate(vertices, faces, count, regularisation=0.005, shape=0.05, altitude=0.0)[:2]


def _qslim(vertices: Array, faces: Array, count: int) -> Mesh:
    import igl

    points, corners, *_ = igl.qslim(vertices, faces.astype(np.int64), count, False)
    return np.asarray(points), np.asarray(corners)


def _unchanged(vertices: Array, faces: Array, _: int) -> Mesh:
    return vertices, faces


DECIMATORS: dict[str, Callable[[Array, Array, int], Mesh]] = {"ndf": _plain, "ndf-even": _even, "qslim": _qslim}
"""fast_simplification is left out: at equal bytes its error was 1.1 to 1.5 times that of these on the five shapes,
and the same only on igea below 4 KB."""


class Point(NamedTuple):
    """One coded mesh. Errors are rms distances as shares of the longest side of the input."""

    name: str
    """decimator/faces/bits."""
    bytes: int
    forward: float
    """Decoded mesh to input."""
    backward: float

    @property
    def rms(self) -> float:
        """Two-sided."""
        return max(self.forward, self.backward)


@dataclass(frozen=True)
class Reference:
    """The input mesh in a frame where its bounding box is centred and its longest side is 1."""

    vertices: Float[Array, "v 3"]
    faces: Int[Array, "f 3"]
    samples: int = 100_000
    seed: int = SEED
    _tree: TriangleBVH = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_tree", TriangleBVH(self.vertices, self.faces))

    @classmethod
    def of(cls, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], samples: int = 100_000) -> Reference:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        return cls((vertices - (low + high) / 2) / float((high - low).max()), faces, samples)

    @cached_property
    def points(self) -> Float[Array, "n 3"]:
        return even_samples(self.vertices, self.faces, self.samples, np.random.default_rng(self.seed))

    def errors(self, vertices: Float[Array, "w 3"], faces: Int[Array, "g 3"]) -> tuple[float, float]:
        """Rms distance from a mesh to the input, and from the input to the mesh."""
        points = even_samples(vertices, faces, self.samples, np.random.default_rng(self.seed + 1))
        forward = self._tree.closest(points)[0] - points
        backward = TriangleBVH(vertices, faces).closest(self.points)[0] - self.points
        return _rms(forward), _rms(backward)


def even_samples(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], count: int, rng: np.random.Generator
) -> Float[Array, "n 3"]:
    """Points spread evenly by area."""
    area = np.linalg.norm(face_normals(vertices, faces), axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    weights = rng.dirichlet([1.0, 1.0, 1.0], count)
    return np.einsum("nc,ncx->nx", weights, vertices[faces[chosen]])


def coded(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], bits: int) -> tuple[int, Mesh]:
    """Bytes of the smallest Draco blob of a mesh, and what it decodes to."""
    import DracoPy

    blob = DracoPy.encode(
        vertices.astype(np.float32), faces.astype(np.uint32), quantization_bits=bits, compression_level=10
    )
    mesh = DracoPy.decode(blob)
    return len(blob), (np.asarray(mesh.points, dtype=np.float64), np.asarray(mesh.faces).astype(np.int32))


def sweep(
    reference: Reference,
    known: Iterable[str] = (),
    face_counts: Sequence[int] = FACES,
    bits: Sequence[int] = BITS,
) -> Iterator[list[Point]]:
    """Measure every combination whose name is not known yet; one list per decimated mesh."""
    known = set(known)
    for count in sorted({min(count, len(reference.faces)) for count in face_counts}):
        methods = DECIMATORS if count < len(reference.faces) else {"input": _unchanged}
        for method, simplify in methods.items():
            names = {f"{method}/{count}/{b}": b for b in bits if f"{method}/{count}/{b}" not in known}
            if not names:
                continue
            vertices, faces = simplify(reference.vertices, reference.faces, count)
            vertices = np.ascontiguousarray(vertices, dtype=np.float64)
            faces = np.ascontiguousarray(faces, dtype=np.int32)
            yield [_point(reference, vertices, faces, name, b) for name, b in names.items()]


def _point(reference: Reference, vertices: Array, faces: Array, name: str, bits: int) -> Point:
    size, mesh = coded(vertices, faces, bits)
    forward, backward = (float(f"{error:.5g}") for error in reference.errors(*mesh))
    return Point(name, size, forward, backward)


def lower_envelope(points: Iterable[Point]) -> list[Point]:
    """The falling part of the lower convex hull of (bytes, rms), by size.

    Not the hull of their logarithms: a small input coded whole, nearly without error, would pull that one far below
    every mesh that there is.
    """
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (p.bytes, p.rms)):
        if best and point.rms >= best[-1].rms:
            continue
        while len(best) > 1 and _turn(best[-2], best[-1], point) <= 0:
            best.pop()
        best.append(point)
    return best


def rms_at(envelope: Sequence[Point], size: float) -> float | None:
    """Error of the envelope at so many bytes; beyond its largest mesh, that one's; None below its smallest.

    Between two of its meshes a power of the size is taken, as face counts between theirs would give: below the chord.
    """
    if not envelope or size < envelope[0].bytes:
        return None
    logs = np.log([[p.bytes, p.rms] for p in envelope])
    return float(np.exp(np.interp(np.log(size), logs[:, 0], logs[:, 1])))


def bytes_at(envelope: Sequence[Point], rms: float) -> float | None:
    """Bytes that the envelope needs for this error; None outside the errors that it covers."""
    if not envelope or not envelope[-1].rms <= rms <= envelope[0].rms:
        return None
    logs = np.log([[p.bytes, p.rms] for p in reversed(envelope)])
    return float(np.exp(np.interp(np.log(rms), logs[:, 1], logs[:, 0])))


def _turn(a: Point, b: Point, c: Point) -> float:
    """Positive where the path a, b, c turns to the left."""
    return (b.bytes - a.bytes) * (c.rms - a.rms) - (b.rms - a.rms) * (c.bytes - a.bytes)


def _rms(difference: Float[Array, "n 3"]) -> float:
    return float(np.sqrt((difference**2).sum(axis=1).mean()))

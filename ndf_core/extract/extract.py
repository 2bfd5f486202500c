"""Extraction: remesh the base mesh until the mapped edges are short enough and the faces even (Sec. 3.4)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator

from ndf_core.asset.asset import Asset
from ndf_core.asset.content import AssetContent
from ndf_core.errors import ExtractionError
from ndf_core.extract.extracted import ExtractedMesh
from ndf_core.extract.intrinsic_delaunay import intrinsic_delaunay
from ndf_core.extract.remeshing import MAX_VERTICES, Remeshing, TooFineError
from ndf_core.kernels.delaunay import delaunay_share, straight_lengths
from ndf_core.kernels.mesh_check import check_mesh, measure_mesh


def extract_mesh(
    asset: Asset | AssetContent, edge_length: float | None = None, threads: int = 1, *, measure_edges: bool = True
) -> ExtractedMesh:
    """A triangle mesh of the surface, in input units.

    Laws: closed and manifold wherever the base mesh is, with its Euler characteristic; no edge is longer than
    `edge_length`, but for `unsplit_edges`; the same bit for bit for every number of threads; the base mesh's
    vertices are kept, so an edge length beyond every mapped edge gives those, and others only where faces would lie
    folded over each other.

    Args:
        asset: What to extract from.
        edge_length: Input units; the asset's longest side over 150 where left out.
        threads: For evaluating the field.
        measure_edges: Measure edges along the surface. Without it `edge_lengths` and `intrinsic` are those of the
            flat triangles, which is enough for a mesh that is only written or drawn, and sooner.

    Raises:
        ExtractionError: the edge length is not a positive number, needs more than 20 million vertices, or the asset's
            field is not finite.
    """
    asset = asset if isinstance(asset, Asset) else Asset(asset)
    wanted = [asset.default_edge_length if edge_length is None else edge_length]
    (mesh,) = refine_mesh(asset, wanted, threads, measure_edges=measure_edges)
    return mesh


def refine_mesh(
    asset: Asset | AssetContent, edge_lengths: Iterable[float], threads: int = 1, *, measure_edges: bool = True
) -> Iterator[ExtractedMesh]:
    """Meshes at edge lengths that do not grow, each refined from the one before.

    Raises:
        ExtractionError: as `extract_mesh`, or an edge length is larger than the one before.
    """
    asset = asset if isinstance(asset, Asset) else Asset(asset)
    state = Remeshing(asset.content, asset.evaluator(), threads)
    before = math.inf
    for edge_length in edge_lengths:
        if not (math.isfinite(edge_length) and edge_length > 0):
            raise ExtractionError(f"the edge length {edge_length} is not a positive number (in the input's units)")
        if edge_length > before:
            raise ExtractionError(f"the edge length {edge_length:g} is larger than the one before, {before:g}")
        before = edge_length
        try:
            mesh = _extracted(asset, state, edge_length, measure_edges)
        except TooFineError as error:
            raise ExtractionError(
                f"the edge length {edge_length:g} needs more than {MAX_VERTICES} vertices; the smallest possible is "
                f"about {error.smallest * asset.content.scale:.3g}"
            ) from None
        yield mesh


def _extracted(asset: Asset, state: Remeshing, edge_length: float, measure_edges: bool) -> ExtractedMesh:
    """One stage, checked from its vertices and faces alone."""
    now = state.refine(edge_length / asset.content.scale)
    vertices = asset.to_input(now.mapped)
    lengths = asset.content.scale * state.edge_lengths() if measure_edges else straight_lengths(vertices, now.faces)
    start = time.perf_counter()
    intrinsic = intrinsic_delaunay(vertices, now.faces, lengths)
    flipped = time.perf_counter()
    check = check_mesh(now.faces, len(vertices))
    shape = measure_mesh(vertices, now.faces, check.twins)
    seconds = {**state.seconds, "delaunay": flipped - start, "check": time.perf_counter() - flipped}
    return ExtractedMesh(
        vertices=vertices,
        faces=now.faces,
        base_faces=now.points.faces,
        barycentric=now.points.barycentric,
        edge_lengths=lengths,
        intrinsic=intrinsic,
        edge_length=float(edge_length),
        statistics={
            "manifold": check.manifold,
            "closed": check.closed,
            "euler_characteristic": check.euler_characteristic,
            "delaunay": delaunay_share(intrinsic),
            "delaunay_extrinsic": shape.delaunay,
            "folded_area": shape.folded_area,
            "unsplit_edges": state.unsplit_edges,
            "seconds": {**seconds, "total": sum(seconds.values())},
        },
    )

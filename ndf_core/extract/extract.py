"""Extraction: subdivide the base mesh until the mapped edges are short enough (Sec. 3.4, first form)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator

import numpy as np

from ndf_core.asset.asset import Asset
from ndf_core.asset.content import AssetContent
from ndf_core.errors import ExtractionError
from ndf_core.extract.extracted import ExtractedMesh
from ndf_core.extract.intrinsic_delaunay import intrinsic_delaunay
from ndf_core.extract.subdivision import MAX_VERTICES, Subdivision, TooFineError
from ndf_core.kernels.delaunay import delaunay_share


def extract_mesh(asset: Asset | AssetContent, edge_length: float | None = None, threads: int = 1) -> ExtractedMesh:
    """A triangle mesh of the surface, in input units.

    Laws: closed and manifold wherever the base mesh is, with its Euler characteristic; no edge is longer than
    `edge_length`; the same bit for bit for every number of threads; an edge length beyond every mapped edge gives the
    base mesh's own triangles, mapped.

    Args:
        asset: What to extract from.
        edge_length: Input units; the asset's longest side over 150 where left out.
        threads: For evaluating the field.

    Raises:
        ExtractionError: the edge length is not a positive number, needs more than 20 million vertices, or the asset's
            field is not finite.
    """
    asset = asset if isinstance(asset, Asset) else Asset(asset)
    (mesh,) = refine_mesh(asset, [asset.default_edge_length if edge_length is None else edge_length], threads)
    return mesh


def refine_mesh(
    asset: Asset | AssetContent, edge_lengths: Iterable[float], threads: int = 1
) -> Iterator[ExtractedMesh]:
    """Meshes at edge lengths that do not grow, each refined from the one before: vertices stay, edges may be flipped.

    Raises:
        ExtractionError: as `extract_mesh`, or an edge length is larger than the one before.
    """
    asset = asset if isinstance(asset, Asset) else Asset(asset)
    state = Subdivision(asset.content, asset.evaluator(), threads)
    before = math.inf
    for edge_length in edge_lengths:
        if not (math.isfinite(edge_length) and edge_length > 0):
            raise ExtractionError(f"the edge length {edge_length} is not a positive number (in the input's units)")
        if edge_length > before:
            raise ExtractionError(f"the edge length {edge_length:g} is larger than the one before, {before:g}")
        before = edge_length
        try:
            state.refine(edge_length / asset.content.scale)
        except TooFineError as error:
            raise ExtractionError(
                f"the edge length {edge_length:g} needs more than {MAX_VERTICES} vertices; the smallest possible is "
                f"about {error.smallest * asset.content.scale:.3g}"
            ) from None
        yield _extracted(asset, state, edge_length)


def _extracted(asset: Asset, state: Subdivision, edge_length: float) -> ExtractedMesh:
    """A copy of the state that later refinement does not touch: only the faces are changed in place, by flips."""
    vertices, faces = asset.to_input(state.mapped), np.copy(state.mesh.corners)
    start = time.perf_counter()
    intrinsic = intrinsic_delaunay(vertices, faces)
    seconds = {"delaunay": time.perf_counter() - start}
    return ExtractedMesh(
        vertices=vertices,
        faces=faces,
        base_faces=state.points.faces,
        barycentric=state.points.barycentric,
        intrinsic=intrinsic,
        edge_length=float(edge_length),
        statistics=state.statistics(seconds) | {"delaunay": delaunay_share(intrinsic)},
    )

"""`Asset`: the public face of an ``.ndf`` file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int, UInt8
from ndf_core.asset.content import AssetContent
from ndf_core.asset.dense_map import BaseLocator
from ndf_core.asset.fields import COLOR, FieldEvaluator, decoded
from ndf_core.asset.file import asset_bytes, format_version, part_bytes, read_asset, write_asset
from ndf_core.mesh import topology

if TYPE_CHECKING:
    from ndf_core.extract.extracted import ExtractedMesh

DEFAULT_FRACTION = 150
"""The default edge length is the longest side over this (the paper's h = 0.02 in a box of 3)."""


class Asset:
    """A base mesh and the fields over it. Immutable; needs neither torch nor the plugin that it was fitted with."""

    def __init__(self, content: AssetContent) -> None:
        self.content = content
        self._evaluators = dict[str, FieldEvaluator]()

    @classmethod
    def load(cls, path: Path | str) -> Asset:
        """Read an asset.

        Raises:
            AssetError: truncated, corrupted, written by a newer version, or inconsistent.
            InputError: there is no such file.
        """
        return cls(read_asset(path))

    def save(self, path: Path | str) -> int:
        """Write the asset atomically and return its size in bytes.

        Raises:
            OutputError: the folder does not exist or cannot be written to.
        """
        return write_asset(self.content, path)

    @cached_property
    def size(self) -> int:
        """Bytes of the file."""
        return len(asset_bytes(self.content))

    @property
    def longest_side(self) -> float:
        """Longest side of the bounding box of the base mesh, where it is placed; input units."""
        vertices = self.content.placed
        return float((vertices.max(axis=0) - vertices.min(axis=0)).max()) * self.content.scale

    @property
    def default_edge_length(self) -> float:
        """Edge length of `extract` where none is given, input units."""
        return self.longest_side / DEFAULT_FRACTION

    def evaluator(self, field: str = "displacement") -> FieldEvaluator:
        """The named field, unpacked once.

        Raises:
            AssetError: there is no such field.
        """
        if field not in self._evaluators:
            self._evaluators[field] = FieldEvaluator(self.content, field)
        return self._evaluators[field]

    def evaluate(
        self,
        faces: Int[Array, " n"],
        barycentric: Float[Array, "n 3"],
        field: str = "displacement",
        threads: int = 1,
    ) -> Float[Array, "n k"]:
        """A field at points of the base mesh, float32, in the box frame.

        Laws: rows are independent; equal to the trained field to 1e-6 of the longest side.

        Raises:
            AssetError: there is no such field over the base mesh, or a face does not exist.
        """
        return self.evaluator(field).at_base(faces, barycentric, threads)

    def values(
        self, field: str, faces: Int[Array, " n"], barycentric: Float[Array, "n 3"], threads: int = 1
    ) -> Array:
        """A learned field at points of the base mesh, such as `base_faces` and `barycentric` of an extracted mesh.

        Returns:
            (n, k) float32 for a continuous field, (n, k) truth values for a binary one, (n,) classes otherwise.

        Raises:
            AssetError: there is no such field over the base mesh, or a face does not exist.
        """
        evaluator = self.evaluator(field)
        return decoded(evaluator.block, evaluator.at_base(faces, barycentric, threads))

    @cached_property
    def _locator(self) -> BaseLocator:
        """The index behind `locate`; made when first needed."""
        return BaseLocator(self.evaluator(), len(self.content.faces))

    def colors(
        self, faces: Int[Array, " n"], barycentric: Float[Array, "n 3"], threads: int = 1
    ) -> UInt8[Array, "n 3"] | None:
        """Red, green and blue at points of the base mesh; None where the asset has no colours."""
        block = self.content.fields.get(COLOR)
        if block is None or block.kind != "continuous" or block.columns != 3:
            return None
        shares = self.values(COLOR, faces, barycentric, threads)
        return np.round(np.clip(shares, 0.0, 1.0) * 255).astype(np.uint8)

    def locate(
        self, points: Float[Array, "n 3"], threads: int = 1
    ) -> tuple[Int[Array, " n"], Float[Array, "n 3"], Float[Array, " n"]]:
        """The base points that are mapped closest to points of the input frame, and their distances, input units.

        Laws: rows are independent; a mapped base point is found again, to the chord error of a fine mesh.

        Raises:
            ValueError: a point is not finite.
        """
        content = self.content
        faces, barycentric, distances = self._locator.closest((points - content.center) / content.scale, threads)
        return faces, barycentric, distances * content.scale

    def map_points(
        self, faces: Int[Array, " n"], barycentric: Float[Array, "n 3"], threads: int = 1
    ) -> Float[Array, "n 3"]:
        """Points of the base mesh on the surface, float64, input units (the paper's g)."""
        return self.to_input(self.evaluate(faces, barycentric, threads=threads))

    def to_input(self, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """From the box frame to input units, float64."""
        return points.astype(np.float64) * self.content.scale + self.content.center

    def extract(
        self, edge_length: float | None = None, threads: int = 1, *, measure_edges: bool = True
    ) -> ExtractedMesh:
        """A triangle mesh of the surface with no edge longer than `edge_length` (input units).

        Without `measure_edges` it is there sooner, and computing on it is as on any flat triangles.

        Raises:
            ExtractionError: the edge length is not a positive number, or needs too many vertices.
        """
        from ndf_core.extract.extract import extract_mesh

        return extract_mesh(self, edge_length, threads, measure_edges=measure_edges)

    def refine(self, edge_lengths: Iterable[float], threads: int = 1) -> Iterator[ExtractedMesh]:
        """Meshes at decreasing edge lengths, each made from the one before.

        Raises:
            ExtractionError: as `extract`, or an edge length is larger than the one before.
        """
        from ndf_core.extract.extract import refine_mesh

        return refine_mesh(self, edge_lengths, threads)

    def info(self) -> dict[str, Any]:
        """What `ndf info --json` prints: sizes in bytes, base mesh, fields, frame, provenance."""
        content = self.content
        counts = topology(content.faces, len(content.vertices))
        return {
            "format_version": format_version(content),
            "bytes": part_bytes(content),
            "base_mesh": {
                "vertices": counts.vertices,
                "faces": counts.faces,
                "components": counts.components,
                "genus": counts.genus,
                "closed": counts.closed,
                "manifold": counts.manifold,
                "boundary_edges": counts.boundary_edges,
                "placed": content.placement is not None,
            },
            "fields": {name: _describe(self.evaluator(name)) for name in sorted(content.fields)},
            "center": [float(value) for value in content.center],
            "scale": content.scale,
            "longest_side": self.longest_side,
            "default_edge_length": self.default_edge_length,
            "provenance": dict(content.provenance),
        }


def _describe(evaluator: FieldEvaluator) -> dict[str, Any]:
    block = evaluator.block
    return {
        "kind": block.kind,
        "domain": block.domain,
        "feature_dim": block.feature_dim,
        "layers": evaluator.widths,
        "levels": block.encoding.levels,
        "base_frequency": block.encoding.base_frequency,
        "include_position": block.encoding.include_position,
        "residual": block.residual,
        "columns": block.columns,
        **({"latent_codes": list(block.latent_shape)} if block.latent is not None else {}),
        **({"labels": list(block.labels)} if block.labels else {}),
    }

"""What a server does once: modes of a shape, and the classifier of their pieces, shipped in its asset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from client import FIELD
from jaxtyping import Bool
from modes import Mode, fracture_modes
from numpy import ndarray as Array
from scipy.spatial import KDTree
from solid import Solid, solid_inside

from ndf_core.asset.asset import Asset
from ndf_core.config.field import FieldConfig
from ndf_core.fitting.field_fit import FieldFit, fit_field
from ndf_core.fitting.field_values import FieldValues
from ndf_core.processing.surface_sampling import white_noise


def with_modes(
    asset: Asset, count: int = 6, spacing: float = 0.12, weight: float = 0.003, steps: int = 1500
) -> tuple[FieldFit, Solid, list[Mode]]:
    """The asset with the field `pieces`, a binary column for each piece of each mode, and the pieces' motions.

    The report's `held_out_overlap` is the intersection over union of each column at points of their own.

    Args:
        asset: of one closed component.
        count: most modes.
        spacing: of the solid's points, as a share of the longest side.
        weight: of cracks against elastic energy; see `fracture_modes`.
        steps: of training.
    """
    longest, center = asset.longest_side, asset.content.center
    mesh = asset.extract(longest / 40, measure_edges=False)
    solid = solid_inside((mesh.vertices - center) / longest, mesh.faces, spacing)
    modes = fracture_modes(solid, count, weight)
    fine = asset.extract(longest / 200, measure_edges=False)
    values = labels_at(solid, modes, (fine.vertices - center) / longest)
    names = [f"mode {i} piece {k}" for i, mode in enumerate(modes) for k in range(len(mode.motions))]
    config = FieldConfig.model_validate(
        {"kind": "binary", "feature_dim": 8, "hidden": 48, "steps": steps, "samples": 2**17}
    )
    fit = fit_field(asset, FieldValues(fine.vertices, values, fine.faces), FIELD, config, names)
    motions = [[[round(float(x), 3) for x in row] for row in mode.motions] for mode in modes]
    content = fit.asset.content
    shipped = Asset(replace(content, provenance={**content.provenance, "fracture": motions}))
    report = {**fit.report, "held_out_overlap": overlaps(shipped, solid, modes)}
    return replace(fit, asset=shipped, report=report), solid, modes


def overlaps(asset: Asset, solid: Solid, modes: list[Mode], count: int = 200_000) -> list[float]:
    """Intersection over union, by area, of each piece as learned and as it is; at random points of the surface."""
    points = white_noise(asset, count, seed=1)
    true = labels_at(solid, modes, (points.points - asset.content.center) / asset.longest_side)
    learned = asset.evaluate(points.base_faces, points.barycentric, FIELD) > 0
    return ((true & learned).sum(axis=0) / (true | learned).sum(axis=0)).tolist()


def labels_at(solid: Solid, modes: list[Mode], points: Array) -> Bool[Array, "n c"]:
    """Truth values for each piece of each mode: that of the closest tetrahedron, by center."""
    closest = KDTree(solid.centers).query(points)[1]
    return np.concatenate([np.eye(len(mode.motions), dtype=bool)[mode.pieces[closest]] for mode in modes], axis=1)

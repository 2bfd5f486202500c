"""The `Surface` of any implicit field: base mesh by marching cubes, projection by Newton, samples by random lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.base_mesh.level_set import LevelSetExtractor, LevelSetPolicy
from ndf_core.interfaces import Surface
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_core.surfaces.level_set_projector import LevelSetProjector
from ndf_core.surfaces.random_lines import sample_level_set


def level_set_surface(
    representation: str,
    field: ImplicitField,
    *,
    resolution: int,
    corrections: int,
    fingerprint: str,
    training_defaults: Mapping[str, Any],
    notes: tuple[str, ...],
    near: Float[Array, "n 3"] | None = None,
    policy: LevelSetPolicy | None = None,
) -> Surface:
    """Assemble a surface.

    Args:
        representation: the `--repr` name.
        field: phi, with the bounds of its surface.
        resolution: cells of the base mesh's grid along the longest side of the bounds; doubled where its topology is
            not settled.
        corrections: most tangential corrections of a projection.
        fingerprint: of content and options.
        training_defaults: fit options that this representation changes.
        notes: one-line remarks for the user.
        near: points about the surface, on each of its components, where they are known; for fields with plateaus.
        policy: how finely to look for the base mesh, if otherwise.
    """
    return Surface(
        representation=representation,
        base_mesh=LevelSetExtractor(
            field.on_arrays(),
            np.stack([field.bounds.lower, field.bounds.upper]),
            # On plateaus the bound keeps nearly every cell; signs find the surface faster.
            lipschitz=None if field.has_plateaus else field.lipschitz,
            near=near,
            policy=policy or LevelSetPolicy(resolution=resolution, max_resolution=2 * resolution),
        ),
        projector=LevelSetProjector(field, corrections),
        fingerprint=fingerprint,
        training_defaults=training_defaults,
        sample=lambda count, rng: sample_level_set(field, count, rng),
        notes=notes,
    )

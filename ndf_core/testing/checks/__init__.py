"""The laws, in the order in which they are checked; every one is a function in a module of this folder."""

from __future__ import annotations

from ndf_core.testing.check import Check
from ndf_core.testing.checks import base_mesh, config, entry, errors, invariance, opening, projector

CHECKS: tuple[Check, ...] = (
    entry.spec_can_be_had,
    *entry.CONTRACT,
    entry.entry_module_is_light,
    entry.entry_module_prints_nothing,
    config.config_takes_the_options,
    config.config_survives_toml,
    config.config_has_a_schema,
    opening.sniff_knows_the_source,
    opening.sniff_leaves_strangers_alone,
    opening.source_can_be_opened,
    opening.fingerprint_is_of_the_content,
    errors.noise_is_refused_by_name,
    errors.half_a_file_does_no_harm,
    base_mesh.base_mesh_can_be_made,
    base_mesh.base_mesh_is_finite,
    base_mesh.base_mesh_is_closed,
    base_mesh.base_mesh_is_manifold,
    base_mesh.base_mesh_is_oriented,
    base_mesh.base_mesh_has_no_flat_faces,
    base_mesh.base_mesh_has_few_faces,
    base_mesh.base_mesh_is_repeatable,
    base_mesh.base_mesh_stays_in_bounds,
    projector.projector_answers,
    projector.projector_reaches_the_surface,
    projector.projector_keeps_type_and_device,
    projector.projector_takes_no_points,
    projector.projector_leaves_its_input_alone,
    projector.projector_refuses_nan,
    projector.far_points_stay_finite,
    projector.far_points_are_flagged,
    projector.normals_are_unit,
    projector.normals_point_outwards,
    invariance.projector_is_pure,
    invariance.projecting_twice_is_projecting_once,
    invariance.points_on_the_surface_stay,
    invariance.batches_do_not_matter,
    invariance.order_does_not_matter,
    invariance.projector_follows_rigid_motion,
    invariance.projector_follows_scale,
)

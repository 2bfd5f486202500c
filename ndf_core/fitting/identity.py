"""Initialisation of both networks: to the identity by construction, or trained there as the paper does (App. A.1)."""

from __future__ import annotations

from ndf_core.asset.content import Encoding
from ndf_core.config.fit import FitConfig
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.network import NetworkShape, Parameters
from ndf_core.fitting.optimizer import Optimizer
from ndf_core.fitting.sampling import generator_at, stratified
from ndf_core.fitting.step import FusedStep, tile_size


def initial_parameters(geometry: BaseGeometry, config: FitConfig) -> Parameters:
    """Parameters that map (almost) every base point to itself.

    With `identity_steps` = 0 the last layers are zero, which is exact because the networks model a residual.
    Otherwise eq. initialization-loss is minimised by Adam from a Kaiming initialisation, for that many steps.
    """
    shape = NetworkShape(
        encoding=Encoding(config.base_frequency, config.encoding_levels, include_position=True),
        hidden_width=config.hidden_width,
        hidden_layers=config.hidden_layers,
        vertex_count=len(geometry.vertices),
        feature_dim=config.feature_dim,
    )
    parameters = Parameters.initial(
        shape,
        config.seed,
        zero_last=config.identity_steps == 0,
        feature_scale=config.feature_scale,
        device=geometry.device,
    )
    parameters.damp_octaves(config.frequency_damping)
    if config.identity_steps:
        train_identity(parameters, geometry, config)
    return parameters


def train_identity(parameters: Parameters, geometry: BaseGeometry, config: FitConfig) -> None:
    """Train both networks to the identity on base points, in place (App. A.1, eq. initialization-loss)."""
    tile = tile_size(config.batch, geometry.device)
    step = FusedStep(parameters.shape, tile, 1, geometry.device)
    adam = Optimizer(parameters, config.model_copy(update={"optimizer": "adam"}))
    tiles = max(1, config.batch // tile)
    for count in range(config.identity_steps):
        generator = generator_at(config.seed, -2 - count)
        step.gradient.flat.zero_()
        for _ in range(tiles):
            step.identity(parameters, stratified(geometry, geometry.areas, tile, generator).batch, 1 / tiles)
        adam.step(step.gradient, 1.0)

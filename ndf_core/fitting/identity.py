"""Initialisation of both networks: to the identity by construction, or trained there as the paper does (App. A.1)."""

from __future__ import annotations

import torch

from ndf_core.asset.content import Encoding
from ndf_core.config.fit import FitConfig
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.network import NetworkShape, Parameters, displace, interpolate, invert
from ndf_core.fitting.sampling import generator_at, stratified


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
    # High octaves start low: at full weight they are noise that the first steps have to unlearn.
    first = parameters.views["forward.weight.0"]
    for level in range(config.encoding_levels):
        first[:, 3 + 6 * level : 9 + 6 * level] *= config.frequency_damping**level
    if config.identity_steps:
        train_identity(parameters, geometry, config)
    return parameters


def train_identity(parameters: Parameters, geometry: BaseGeometry, config: FitConfig) -> None:
    """Train both networks to the identity on base points, in place (App. A.1, eq. initialization-loss)."""
    flat = parameters.flat.detach().requires_grad_()
    live = Parameters(parameters.shape, flat)
    adam = torch.optim.Adam([flat], lr=config.learning_rate)
    for step in range(config.identity_steps):
        batch = stratified(geometry, geometry.areas, config.batch, generator_at(config.seed, -2 - step)).batch
        features = interpolate(live.features, batch.corners, batch.barycentric)
        forward = displace(live, batch.positions, features) - batch.positions
        inverse = invert(live, batch.positions) - batch.positions
        adam.zero_grad()
        (forward.square().sum() + inverse.square().sum()).div(config.batch).backward()
        adam.step()
    parameters.flat.copy_(flat.detach())

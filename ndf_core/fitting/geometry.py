"""The base mesh as tensors, and the differential geometry of the mapped surface (Sec. 3.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.fitting.network import Parameters, frequency_matrix


class BaseGeometry:
    """Base mesh in the box frame, with what sampling needs per face. Tensors on one device, float32."""

    def __init__(
        self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], device: torch.device | str = "cpu"
    ) -> None:
        corners = vertices[faces]
        area_vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        self.vertices = torch.tensor(vertices, dtype=torch.float32, device=device)
        self.faces = torch.tensor(faces, dtype=torch.int64, device=device)
        self.areas = torch.tensor(np.linalg.norm(area_vectors, axis=1), dtype=torch.float32, device=device)
        self.corner_positions = self.vertices[self.faces]
        self.device = device

    def positions(self, face: Int[Tensor, " n"], barycentric: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Base points in the box frame."""
        return torch.bmm(barycentric[:, None, :], self.corner_positions[face])[:, 0]


class Frame(NamedTuple):
    """Unit normal and two unit tangents (orthogonal, right-handed) at points of a surface."""

    normal: Float[Tensor, "n 3"]
    first: Float[Tensor, "n 3"]
    second: Float[Tensor, "n 3"]


def base_frames(geometry: BaseGeometry, face: Int[Tensor, " n"]) -> Frame:
    """n, t1, t2 of the base mesh at points of the given faces; t1 runs along the face's first edge."""
    a, b, c = geometry.corner_positions[face].unbind(1)
    first = torch.nn.functional.normalize(b - a, dim=1)
    normal = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=1)
    return Frame(normal, first, torch.linalg.cross(normal, first))


def pushforward(
    parameters: Parameters,
    geometry: BaseGeometry,
    face: Int[Tensor, " n"],
    barycentric: Float[Tensor, "n 3"],
    tangents: Float[Tensor, "n k 3"],
) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n k 3"]]:
    """g(x) and J_theta t for k tangent vectors of the base mesh at each base point.

    The features depend on x through the barycentric weights, so the derivative of the weights inside the face is
    part of J_theta. Differentiable with respect to the parameters. Values and tangents go through the layers side by
    side; a ReLU passes a tangent where it passes the value. (torch.func.jvp gives the same bits, in twice the time
    and after a second of imports.)

    Reference: Sec. 3.1; the pushforward d g^x is the linear map t -> J_theta(x) t.
    """
    encoding = parameters.shape.encoding
    positions = geometry.positions(face, barycentric)
    rates = barycentric_rates(geometry.corner_positions[face], tangents)
    features = torch.cat([barycentric[:, None], rates], 1) @ parameters.features[geometry.faces[face]]
    matrix, phase = (part.to(positions.dtype) for part in frequency_matrix(encoding, geometry.device))
    angles, first = positions @ matrix + phase, encoding.width - matrix.shape[1]
    value = torch.cat([positions[:, :first], torch.sin(angles), features[:, 0]], 1)
    rate = torch.cat([tangents[:, :, :first], (tangents @ matrix) * torch.cos(angles)[:, None], features[:, 1:]], 2)
    for index, (weight, bias) in enumerate(parameters.layers("forward")):
        value, rate = torch.nn.functional.linear(value, weight, bias), rate @ weight.t()
        if index < parameters.shape.hidden_layers:
            value, rate = torch.relu(value), rate * (value > 0)[:, None]
    return positions + value, tangents + rate


def barycentric_rates(triangles: Float[Tensor, "n 3 3"], tangents: Float[Tensor, "n k 3"]) -> Float[Tensor, "n k 3"]:
    """Derivative of the barycentric weights along tangent vectors of each triangle.

    With e1 = b - a and e2 = c - a, the weights of b and c move by the solution of [e1 e2] r = t, that is by
    G^-1 [e1.t, e2.t] with the Gram matrix G; that of a by minus their sum.
    """
    a, b, c = triangles.unbind(1)
    one, two = b - a, c - a
    g11, g12, g22 = (one * one).sum(1), (one * two).sum(1), (two * two).sum(1)
    determinant = g11 * g22 - g12 * g12
    along_one = torch.einsum("nkx,nx->nk", tangents, one)
    along_two = torch.einsum("nkx,nx->nk", tangents, two)
    rate_b = (g22[:, None] * along_one - g12[:, None] * along_two) / determinant[:, None]
    rate_c = (g11[:, None] * along_two - g12[:, None] * along_one) / determinant[:, None]
    return torch.stack([-rate_b - rate_c, rate_b, rate_c], dim=-1)


class MappedFrame(NamedTuple):
    """First-order geometry of the mapped surface at base points."""

    points: Float[Tensor, "n 3"]
    frame: Frame
    """Unit normal n_theta and tangents t1_theta (along J t1), t2_theta of the mapped surface."""
    jacobian: Float[Tensor, "n 2 2"]
    """The local Jacobian J_f in the base frame and `frame` (eq. jacobian)."""
    area_ratio: Float[Tensor, " n"]
    """|J t1 x J t2| = |det J_f|: mapped area per base area."""


def mapped_frame(
    parameters: Parameters, geometry: BaseGeometry, face: Int[Tensor, " n"], barycentric: Float[Tensor, "n 3"]
) -> MappedFrame:
    """Normal, tangents and local Jacobian of the mapped surface, box frame.

    n_theta = J t1 x J t2 / |J t1 x J t2|: the denominator printed in Sec. 3.1 repeats one norm. In the frame built
    from J itself det J_f is never negative; a fold shows in n_theta against the surface's normal instead.

    Reference: Sec. 3.1, eq. jacobian.
    """
    base = base_frames(geometry, face)
    points, columns = pushforward(parameters, geometry, face, barycentric, torch.stack([base.first, base.second], 1))
    one, two = columns.unbind(1)
    area = torch.linalg.cross(one, two)
    ratio = torch.linalg.vector_norm(area, dim=1)
    normal = area / ratio.clamp_min(1e-30)[:, None]
    first = torch.nn.functional.normalize(one, dim=1)
    second = torch.linalg.cross(normal, first)
    jacobian = torch.stack([first, second], 1) @ torch.stack([one, two], 2)
    return MappedFrame(points, Frame(normal, first, second), jacobian, ratio)


@torch.no_grad()
def area_ratio(
    parameters: Parameters, geometry: BaseGeometry, face: Int[Tensor, " n"], barycentric: Float[Tensor, "n 3"]
) -> Float[Tensor, " n"]:
    """|det J_f| alone, for sampling: `mapped_frame(...).area_ratio` without gradient, in less memory.

    Values and two tangents go through the layers as one block of 3 n rows.
    """
    shape, count = parameters.shape, len(face)
    base = base_frames(geometry, face)
    tangents = torch.stack([base.first, base.second])
    corners = parameters.features[geometry.faces[face]]
    rates = barycentric_rates(geometry.corner_positions[face], tangents.transpose(0, 1))
    positions = geometry.positions(face, barycentric)
    matrix, phase = frequency_matrix(shape.encoding, geometry.device)
    angles = torch.addmm(phase, positions, matrix)
    block = torch.empty(3, count, shape.encoding.width + shape.feature_dim, device=geometry.device)
    first = shape.encoding.width - matrix.shape[1]
    block[0, :, :first], block[1:, :, :first] = positions[:, :first], tangents[:, :, :first]
    torch.sin(angles, out=block[0, :, first : shape.encoding.width])
    torch.mul(tangents @ matrix, torch.cos(angles), out=block[1:, :, first : shape.encoding.width])
    weights = torch.cat([barycentric[:, None], rates], 1)
    block[:, :, shape.encoding.width :] = torch.bmm(weights, corners).transpose(0, 1)
    rows = block.view(3 * count, -1)
    for index, (weight, bias) in enumerate(parameters.layers("forward")):
        rows = rows @ weight.t()
        values = rows[:count].add_(bias)
        if index < shape.hidden_layers:
            rows.view(3, count, -1).mul_(values > 0)
    one, two = rows[count : 2 * count] + tangents[0], rows[2 * count :] + tangents[1]
    return torch.linalg.vector_norm(torch.linalg.cross(one, two), dim=1)

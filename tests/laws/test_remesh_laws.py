"""Intrinsic triangulations under random edits: edges stay straight lines, the surface stays."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.spatial import Delaunay
from small_assets import Mesh, icosphere, open_grid, torus

from ndf_core.kernels.mesh_check import check_mesh, measure_mesh
from ndf_core.kernels.reference import remesh as reference
from ndf_core.kernels.remesh import BasePoints, FlipAim, RemeshKernel


def noisy(mesh: Mesh, seed: int, amount: float) -> Mesh:
    vertices, faces = mesh
    return vertices + np.random.default_rng(seed).normal(size=vertices.shape) * amount, faces


def planar(seed: int) -> Mesh:
    """Random triangles in a tilted plane."""
    points = np.concatenate([np.random.default_rng(seed).random((60, 2)), [[0, 0], [1, 0], [0, 1], [1, 1]]])
    faces = Delaunay(points).simplices.astype(np.int32)
    corner = points[faces]
    turned = np.linalg.det(corner[:, 1:] - corner[:, :1]) < 0
    faces[turned] = faces[turned][:, ::-1]
    return points @ np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0][:2], faces


def fan(valence: int, angle: float) -> Mesh:
    """A cone of `valence` triangles whose angles at the apex are `angle` (radians): needles, if that is small."""
    turn = np.arange(valence) * angle
    height = np.where(np.arange(valence) % 2, 0.1, -0.1) if angle > 0.01 else np.zeros(valence)
    ring = np.stack([np.cos(turn), np.sin(turn), height], axis=1)
    other = (np.arange(valence - 1) + 1) % valence
    faces = np.stack([np.zeros(valence - 1, int), np.arange(valence - 1) + 1, other + 1], axis=1)
    return np.concatenate([np.zeros((1, 3)), ring]), faces.astype(np.int32)


MESHES = {
    "planar": planar(1),
    "sphere": noisy(icosphere(1), 2, 0.08),
    "torus": noisy(torus(10, 6), 3, 0.03),
    "open": noisy(open_grid(5), 4, 0.03),
    "valence 500": fan(500, 2 * np.pi / 499),
    "drawn out": (icosphere(1)[0] * np.array([40.0, 1.0, 1.0]), icosphere(1)[1]),
}


class State:
    """A triangulation under edits whose map is the base mesh itself, and what must never change."""

    def __init__(self, mesh: Mesh) -> None:
        self.vertices, self.faces = mesh
        self.twins = check_mesh(self.faces, len(self.vertices)).twins
        self.kernel = RemeshKernel(self.vertices, self.faces, self.twins, self.vertices)
        lengths = np.linalg.norm(self.vertices[self.faces] - self.vertices[np.roll(self.faces, -1, axis=1)], axis=2)
        self.area = areas(lengths).sum()
        self.cone = np.bincount(self.faces.ravel(), angles(lengths).ravel(), minlength=len(self.vertices))
        self.euler = check_mesh(self.faces, len(self.vertices)).euler_characteristic

    def positions(self, points: BasePoints) -> Float[Array, "n 3"]:
        return np.einsum("nk,nkc->nc", points.barycentric, self.vertices[self.faces[points.faces]])

    def split(self, limit: float) -> int:
        places, refused = self.kernel.find_long_edges(limit, along=False)
        return len(places.faces) - self.kernel.split(self.positions(places)) - refused

    def move(self) -> int:
        return self.kernel.move(self.positions(self.kernel.find_moves()))

    def check(self) -> None:
        now, edges = self.kernel.triangulation(), self.kernel.half_edges()
        topology = check_mesh(now.faces, len(now.mapped))
        np.testing.assert_array_equal(topology.twins, edges.twins)
        assert topology.manifold  # simplicial, too: no face or edge is doubled
        assert topology.euler_characteristic == self.euler
        lengths = np.linalg.norm(edges.vectors, axis=2)
        inner = edges.twins.ravel() >= 0
        np.testing.assert_allclose(lengths.ravel()[inner], lengths.ravel()[edges.twins.ravel()[inner]], rtol=1e-9)
        assert (lengths.sum(axis=1)[:, None] > 2 * lengths).all()
        assert areas(lengths).sum() == pytest.approx(self.area, rel=1e-9)
        # Angles add up to those of the cone, which are pi or two pi where a vertex was put on an edge.
        sums = np.bincount(now.faces.ravel(), angles(lengths).ravel())
        corner = now.points.barycentric.max(axis=1) == 1
        base = self.faces[now.points.faces, now.points.barycentric.argmax(axis=1)]
        border = np.zeros(len(sums), dtype=bool)
        border[now.faces[edges.twins < 0]] = True
        flat = np.where(border, np.pi, 2 * np.pi)
        np.testing.assert_allclose(sums, np.where(corner, self.cone[base], flat), atol=1e-6)
        assert sorted(base[corner]) == list(range(len(self.vertices)))
        np.testing.assert_allclose(now.mapped, self.positions(now.points), atol=1e-12)

    def check_lines(self, count: int) -> None:
        """Some of the edges, followed in space, end at their vertices."""
        now, edges = self.kernel.triangulation(), self.kernel.half_edges()
        ends = np.roll(now.faces, -1, axis=1).ravel()
        for h in np.random.default_rng(0).permutation(now.faces.size)[:count]:
            start, home = now.mapped[now.faces.ravel()[h]], int(edges.homes.ravel()[h])
            vector = reference.in_space(self.vertices[self.faces[home]], edges.vectors.reshape(-1, 2)[h])
            end = reference.end_of_line(self.vertices, self.faces, self.twins, home, start, vector)
            np.testing.assert_allclose(end, now.mapped[ends[h]], atol=1e-9 * np.ptp(self.vertices))


def areas(lengths: Float[Array, "f 3"]) -> Float[Array, " f"]:
    c, b, a = np.sort(lengths, axis=1).T
    return np.sqrt(np.maximum((a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)), 0)) / 4


def angles(lengths: Float[Array, "f 3"]) -> Float[Array, "f 3"]:
    """At the start of each half-edge, from its length, the one before and the one opposite."""
    b, c, a = lengths, np.roll(lengths, 1, axis=1), np.roll(lengths, -1, axis=1)
    rest, all_ = np.maximum(b + c - a, 1e-300), a + b + c
    return 2 * np.arctan(np.sqrt(np.maximum(a + b - c, 0) * np.maximum(a + c - b, 0) / (rest * all_)))


def random_edits(state: State, count: int, seed: int, most_vertices: int) -> Int[Array, "3"]:
    """Done edits by kind: flips, splits, removals. About `count` are tried."""
    rng = np.random.default_rng(seed)
    done, tried = np.zeros(3, dtype=int), 0
    while tried < count:
        now = state.kernel.triangulation()
        lengths = np.linalg.norm(now.mapped[now.faces] - now.mapped[np.roll(now.faces, -1, axis=1)], axis=2)
        if len(now.mapped) < most_vertices:
            split = state.split(float(np.quantile(lengths, rng.uniform(0.9, 1.0))))
            done[1] += split
            tried += split
        for half_edge in rng.integers(0, now.faces.size, 100):
            done[0] += state.kernel.flip_edge(int(half_edge))
        for vertex in rng.permutation(len(now.mapped))[:30]:
            done[2] += state.kernel.remove_vertex(int(vertex))
        tried += 130
        state.move()
    return done


@pytest.mark.parametrize("name", MESHES)
def test_random_edits_keep_every_law(name: str) -> None:
    state = State(MESHES[name])
    state.check()
    for seed in range(4):
        done = random_edits(state, 2500, seed, most_vertices=3 * len(state.vertices) + 200)
        assert (done > 50).all(), done
        state.check()
    state.check_lines(300)


@pytest.mark.parametrize("name", ["planar", "torus"])
def test_nearly_all_that_was_added_can_be_removed(name: str) -> None:
    state = State(MESHES[name])
    for _ in range(4):
        state.split(0.0)
    added = state.kernel.vertex_count - len(state.vertices)
    assert added > 10 * len(state.vertices)
    for _ in range(20):
        state.kernel.remove_short_edges(1e9)
        state.kernel.flip(FlipAim.LOWER_ENERGY, 1e9)
    assert state.kernel.vertex_count - len(state.vertices) < 0.02 * added
    state.check()


def test_an_edge_on_a_plane_is_the_segment_between_its_ends() -> None:
    """Flips across any number of base edges, down to the Delaunay triangulation of the plane's points."""
    state = State(MESHES["planar"])
    random_edits(state, 3000, 5, most_vertices=400)
    for _ in range(10):
        if not state.kernel.flip(FlipAim.DELAUNAY, 1e9)[0]:
            break
    now, edges = state.kernel.triangulation(), state.kernel.half_edges()
    straight = now.mapped[np.roll(now.faces, -1, axis=1)] - now.mapped[now.faces]
    np.testing.assert_allclose(np.linalg.norm(edges.vectors, axis=2), np.linalg.norm(straight, axis=2), rtol=1e-9)
    frame = np.linalg.svd(now.mapped - now.mapped.mean(axis=0))[2][:2]
    expected = {tuple(sorted(face)) for face in Delaunay(now.mapped @ frame.T).simplices.tolist()}
    found = {tuple(sorted(face)) for face in now.faces.tolist()}
    assert len(expected - found) <= 0.02 * len(expected)  # nearly flat triangles along the border


@pytest.mark.parametrize(
    "mesh",
    [
        fan(100, 1e-6),
        noisy(fan(60, 1e-7), 0, 1e-9),
        (icosphere(1)[0] * np.array([1e6, 1.0, 1e-6]), icosphere(1)[1]),
        (icosphere(1)[0] * 1e12, icosphere(1)[1]),
        (icosphere(1)[0] * 1e-12, icosphere(1)[1]),
        (open_grid(6)[0] * np.array([1.0, 0.0, 0.0]), open_grid(6)[1]),
        (open_grid(6)[0] * 0.0, open_grid(6)[1]),
    ],
    ids=["needles", "thinner", "flattened", "huge", "tiny", "no area", "a point"],
)
def test_degenerate_base_meshes_are_refined_like_others(mesh: Mesh) -> None:
    """Topology and map stay, whatever the base mesh's triangles are like; their images are not degenerate."""
    vertices, faces = mesh
    twins = check_mesh(faces, len(vertices)).twins
    target = np.random.default_rng(0).normal(size=vertices.shape)
    kernel = RemeshKernel(vertices, faces, twins, target)

    def mapped(points: BasePoints) -> Float[Array, "n 3"]:
        return np.einsum("nk,nkc->nc", points.barycentric, target[faces[points.faces]])

    for limit in (1.0, 0.5, 0.3):
        for _ in range(8):
            places, _ = kernel.find_long_edges(limit, along=False)
            kernel.split(mapped(places))
            kernel.flip(FlipAim.LOWER_ENERGY, limit)
        kernel.remove_short_edges(limit / 4)
        kernel.move(mapped(kernel.find_moves()))
        kernel.flip(FlipAim.DELAUNAY, limit)
    now = kernel.triangulation()
    after = check_mesh(now.faces, len(now.mapped))
    assert after.manifold
    assert after.euler_characteristic == check_mesh(faces, len(vertices)).euler_characteristic
    assert len(now.mapped) > 3 * len(vertices)
    np.testing.assert_allclose(now.mapped, mapped(now.points), atol=1e-12)
    longest = np.linalg.norm(now.mapped[now.faces] - now.mapped[np.roll(now.faces, -1, axis=1)], axis=2)
    assert np.median(longest) < 0.3


def test_halving_edges_at_folds_unfolds_what_is_round() -> None:
    """A lens has a round rim; triangles that are large for it lie folded over each other there."""
    vertices, faces = icosphere(1)
    twins = check_mesh(faces, len(vertices)).twins
    lens = np.array([1.0, 1.0, 0.1])

    def mapped(points: BasePoints) -> Float[Array, "n 3"]:
        on_faces = np.einsum("nk,nkc->nc", points.barycentric, vertices[faces[points.faces]])
        return on_faces / np.linalg.norm(on_faces, axis=1, keepdims=True) * lens

    def folded_area() -> float:
        now = kernel.triangulation()
        return measure_mesh(now.mapped, now.faces, check_mesh(now.faces, len(now.mapped)).twins).folded_area

    kernel = RemeshKernel(vertices, faces, twins, vertices * lens)
    assert folded_area() > 0.04
    while len((places := kernel.find_folded_edges()).faces) and kernel.vertex_count < 4 * len(vertices):
        kernel.split(mapped(places))
        kernel.flip(FlipAim.DELAUNAY, np.inf)
    assert folded_area() == 0
    assert kernel.vertex_count < 2 * len(vertices)


def test_the_same_on_every_run() -> None:
    states = [State(MESHES["torus"]), State(MESHES["torus"])]
    for state in states:
        random_edits(state, 1000, 7, most_vertices=500)
    one, two = ((*state.kernel.triangulation().points, *state.kernel.half_edges()) for state in states)
    for left, right in zip(one, two, strict=True):
        np.testing.assert_array_equal(left, right)


def test_faulty_arguments_are_refused() -> None:
    vertices, faces = icosphere(0)
    twins = check_mesh(faces, 12).twins
    with pytest.raises(ValueError, match="oriented manifold"):
        RemeshKernel(vertices, faces, np.roll(twins, 1, axis=0), vertices)
    with pytest.raises(ValueError, match="uses all positions"):
        RemeshKernel(np.concatenate([vertices, vertices]), faces, twins, np.concatenate([vertices, vertices]))
    with pytest.raises(ValueError, match="not finite"):
        RemeshKernel(np.full((12, 3), np.inf), faces, twins, vertices)
    kernel = RemeshKernel(vertices, faces, twins, vertices)
    kernel.find_long_edges(0.1, along=False)
    with pytest.raises(ValueError, match="need 30 rows, got 3"):
        kernel.split(np.zeros((3, 3)))
    with pytest.raises(IndexError, match="no half-edge or vertex 60"):
        kernel.flip_edge(60)
    with pytest.raises(IndexError, match="no half-edge or vertex -1"):
        kernel.remove_vertex(-1)
    assert not kernel.remove_vertex(3)  # of the base mesh

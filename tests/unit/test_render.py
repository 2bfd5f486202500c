"""Pictures: geometry of the projection, what is drawn where, and files that other programs can read."""

from __future__ import annotations

import struct
import subprocess
import sys
import zlib
from pathlib import Path

import jaxtyping
import numpy as np
import pytest
from jaxtyping import Float, Int, UInt8
from numpy import ndarray as Array

from ndf_core.errors import OutputError
from ndf_core.render import Camera, ColorBar, colormap, panels, render_mesh, write_png
from ndf_core.render.shading import clay_light, corner_normals, to_linear, to_srgb
from ndf_core.render.strokes import GLYPHS, segments
from ndf_core.render.text import draw_text, text_width, wrap_text

Mesh = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]


def icosphere(rounds: int) -> Mesh:
    """Unit sphere, counter-clockwise from outside."""
    vertices = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
    for _ in range(rounds):
        edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = index.reshape(-1, 3) + len(vertices)
        vertices = np.concatenate([vertices, vertices[unique].mean(axis=1)])
        a, b, c, ab, bc, ca = *faces.T, *middle.T
        faces = np.concatenate([np.stack(x, axis=1) for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    return vertices, faces


def cube() -> Mesh:
    vertices = np.array([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return vertices, np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])


def drawn(image: UInt8[Array, "h w 3"]) -> Float[Array, "h w"]:
    """How much of each pixel is not background, where the mesh is black on white."""
    return 1 - to_linear(image / 255)[..., 0]


def test_the_outline_of_a_sphere_has_the_area_of_its_projection() -> None:
    vertices, faces = icosphere(5)
    camera = Camera.framing(vertices, (20, 30), margin=0.1)
    image = render_mesh(vertices, faces, width=300, height=300, view=camera, background=(0.0, 1.0, 0.0))
    outside = (image == [0, 255, 0]).all(axis=2)
    distance = np.linalg.norm(camera.eye)
    # The cone that touches the sphere has half angle asin(1 / d), seen on the picture as a disc.
    radius = 150 * np.tan(np.arcsin(1 / distance)) / camera.tangent
    touched = (~outside).sum()
    assert np.pi * radius**2 < touched < np.pi * (radius + 1.5) ** 2
    assert radius == pytest.approx(0.8 * 150, rel=2e-3)  # fits into what the margins leave


def test_antialiased_pixels_are_covered_in_proportion() -> None:
    vertices, faces = cube()
    half = vertices[:, 0] + 3 * vertices[:, 1] < 0
    kept = faces[half[faces].all(axis=1)]
    black = np.zeros((len(vertices), 3))
    camera = Camera.framing(vertices, (25, 40))
    small, large = (
        drawn(render_mesh(vertices, kept, width=n, height=n, view=camera, colors=black)) for n in (80, 640)
    )
    blocks = large.reshape(80, 8, 80, 8).mean(axis=(1, 3))
    assert np.abs(small - blocks).max() < 0.3
    assert np.abs(small - blocks).mean() < 0.01
    assert ((small > 0.2) & (small < 0.8)).sum() > 20


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("up", ["y", "z"])
def test_framing_fits_exactly(aspect: float, up: str) -> None:
    points = np.random.default_rng(0).normal(size=(200, 3)) * [3, 1, 0.2] * 1e-3 + [5, 6, 7]
    width, height = round(400 * aspect), 400
    for view in ((0.0, 0.0), (35.0, 25.0), (200.0, -60.0), (10.0, 90.0)):
        camera = Camera.framing(points, view, aspect=aspect, up=up, margin=0.05)
        assert np.allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-14)
        places = camera.project(points, width, height) / [width, height]
        low, high = places.min(axis=0), places.max(axis=0)
        assert np.all(low >= 0.05 - 1e-9)
        assert np.all(high <= 0.95 + 1e-9)
        assert np.isclose(low, 0.05).any()
        assert np.isclose(high, 0.95).any()


def test_rays_go_through_the_pixels_that_points_project_to() -> None:
    points = np.random.default_rng(1).normal(size=(50, 3))
    camera = Camera.framing(points, (40, 10), aspect=1.5)
    places = camera.project(points, 300, 200)
    origins, directions = camera.rays(places[:, 0], places[:, 1], 300, 200)
    depth = ((points - origins) * -camera.axes[2]).sum(axis=1)
    assert np.allclose(origins + depth[:, None] * directions, points, atol=1e-12)


def test_views_show_the_sides_that_they_say() -> None:
    vertices, faces = cube()
    normals = np.cross(*(vertices[faces[:, i]] - vertices[faces[:, 0]] for i in (1, 2)))
    colors = np.where(normals > 0, 1.0, 0.0) + np.where(normals < 0, 0.4, 0.0)
    sides = {(0, 0): 2, (90, 0): 0, (0, 89): 1}
    for view, axis in sides.items():
        image = render_mesh(vertices, faces, width=21, height=21, view=view, colors=colors)
        assert np.argmax(image[10, 10]) == axis
    image = render_mesh(vertices, faces, width=21, height=21, view=(0, 0), up="z", colors=colors)
    assert image[10, 10, 1] > 2 * image[10, 10, 0]
    assert image[10, 10, 1] < 200  # the front is -y


@pytest.mark.parametrize("options", [{}, {"wireframe": True, "crease": 0.0}, {"antialias": False}])
def test_the_picture_is_the_same_for_any_number_of_threads(options: dict[str, bool]) -> None:
    vertices, faces = icosphere(3)
    one = render_mesh(vertices, faces, width=120, height=90, **options)
    three = render_mesh(vertices, faces, width=120, height=90, threads=3, **options)
    assert np.array_equal(one, three)
    assert one.shape == (90, 120, 3)


def test_the_picture_does_not_depend_on_units() -> None:
    vertices, faces = icosphere(3)
    one = render_mesh(vertices, faces, width=100, height=100).astype(int)
    two = render_mesh(vertices * 2.0**-20 + 1, faces, width=100, height=100).astype(int)
    assert (np.abs(one - two) > 2).mean() < 0.005


def test_wireframe_darkens_edges_and_only_edges() -> None:
    vertices, faces = icosphere(1)
    plain = render_mesh(vertices, faces, width=300, height=300, crease=0).astype(int).sum(axis=2)
    lines = render_mesh(vertices, faces, width=300, height=300, crease=0, wireframe=True).astype(int).sum(axis=2)
    camera = Camera.framing(vertices)
    darker = plain - lines > 60
    rows, columns = np.nonzero(darker)
    start, end = (camera.project(vertices[part], 300, 300) for part in (faces.ravel(), np.roll(faces, -1, 1).ravel()))
    pixels = np.stack([columns, rows], axis=1)[:, None] + 0.5
    along = end - start
    t = np.clip(((pixels - start) * along).sum(-1) / (along**2).sum(-1), 0, 1)
    assert np.linalg.norm(pixels - start - t[..., None] * along, axis=-1).min(axis=1).max() < 2
    turn = along[::3, 0] * along[1::3, 1] - along[::3, 1] * along[1::3, 0]
    front = turn < 0  # the other way round, as rows grow downwards
    middles = ((start + end) / 2)[np.repeat(front, 3)].astype(int)
    assert np.mean([darker[r - 1 : r + 2, c - 1 : c + 2].any() for c, r in middles]) > 0.9
    assert (lines > plain).mean() < 0.01


def test_dense_wireframes_fade_instead_of_blackening() -> None:
    vertices, faces = icosphere(5)
    plain = render_mesh(vertices, faces, width=60, height=60).astype(int)
    lines = render_mesh(vertices, faces, width=60, height=60, wireframe=True).astype(int)
    assert np.abs(plain - lines).max() <= 8
    assert np.abs(plain - lines).mean() < 0.5


def test_the_inside_is_told_from_the_outside() -> None:
    vertices, faces = icosphere(3)
    outside = render_mesh(vertices, faces, width=60, height=60)[30, 30].astype(int)
    inside = render_mesh(vertices, faces[:, ::-1], width=60, height=60)[30, 30].astype(int)
    assert inside[0] - inside[2] > outside[0] - outside[2] + 20


def test_normals_are_smooth_across_small_bends_and_sharp_across_large_ones() -> None:
    vertices, faces = icosphere(4)
    smooth = corner_normals(vertices, faces)
    assert np.linalg.norm(smooth - vertices[faces], axis=2).max() < np.radians(1)
    box, sides = cube()
    flat = np.cross(box[sides[:, 1]] - box[sides[:, 0]], box[sides[:, 2]] - box[sides[:, 0]]) / 4
    assert np.allclose(corner_normals(box, sides), flat[:, None], atol=1e-12)
    assert np.allclose(np.abs(corner_normals(box, sides, crease=180)), 3**-0.5, atol=1e-12)
    degenerate = np.array([[0, 1, 1]])
    assert np.isfinite(corner_normals(box, np.concatenate([sides, degenerate]))).all()


def test_light_keeps_a_facing_surface_at_its_own_brightness() -> None:
    light, _ = clay_light(np.array([[0.0, 0, 1]]))
    assert np.all(np.abs(light - 1) < 0.15)


def test_srgb_round_trips() -> None:
    values = np.linspace(0, 1, 256)[:, None].repeat(3, axis=1)
    assert np.allclose(to_srgb(to_linear(values)), values, atol=1e-7)


# What the published tables have at 0, 1/4, 1/2, 3/4 and 1.
VIRIDIS = ["440154", "3b528b", "21918c", "5ec962", "fde725"]


def test_viridis_is_viridis() -> None:
    expected = np.array([list(bytes.fromhex(entry)) for entry in VIRIDIS])
    assert np.abs(colormap(np.linspace(2, 6, 5), 2, 6) * 255 - expected).max() < 6


@pytest.mark.parametrize("name", ["viridis", "heat"])
def test_lightness_is_monotonic(name: str) -> None:
    colors = to_linear(colormap(np.linspace(0, 1, 200), 0, 1, name))
    steps = np.diff(colors @ [0.2126, 0.7152, 0.0722])
    assert np.all(steps > 0) or np.all(steps < 0)


def test_values_beyond_the_range_get_the_ends_and_nan_grey() -> None:
    colors = colormap(np.array([[-5.0, 0], [1, 7], [np.nan, 0.5]]), 0, 1, "turbo")
    assert colors.shape == (3, 2, 3)
    assert np.array_equal(colors[0, 0], colors[0, 1])
    assert np.array_equal(colors[1, 0], colors[1, 1])
    assert np.all(colors[2, 0] == 0.5)
    with pytest.raises(ValueError, match="vmin must be below vmax"):
        colormap(np.zeros(2), 1, 1)


def decode(data: bytes) -> UInt8[Array, "h w c"]:
    """A PNG decoder for 8-bit pictures, filter by filter as the standard says."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    chunks: dict[bytes, bytes] = {}
    at = 8
    while at < len(data):
        (size,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        assert struct.unpack(">I", data[at + 8 + size : at + 12 + size])[0] == zlib.crc32(kind + body)
        chunks[kind] = chunks.get(kind, b"") + body
        at += 12 + size
    assert list(chunks) == [b"IHDR", b"sRGB", b"IDAT", b"IEND"]
    width, height, depth, color, *rest = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    assert (depth, rest) == (8, [0, 0, 0])
    channels = {0: 1, 2: 3, 6: 4}[color]
    raw = zlib.decompress(chunks[b"IDAT"])
    stride = width * channels
    assert len(raw) == height * (stride + 1)
    above = [0] * stride
    rows: list[list[int]] = []
    for y in range(height):
        kind, line = raw[y * (stride + 1)], list(raw[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        for x in range(stride):
            a = line[x - channels] if x >= channels else 0
            b, c = above[x], above[x - channels] if x >= channels else 0
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            line[x] = (line[x] + [0, a, b, (a + b) // 2, nearest][kind]) % 256
        rows.append(line)
        above = line
    return np.array(rows, dtype=np.uint8).reshape(height, width, channels)


@pytest.mark.parametrize("shape", [(1, 1, 3), (7, 5, 3), (40, 60, 3), (9, 4, 4), (6, 8)])
def test_png_round_trip(shape: tuple[int, ...], tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    smooth = np.add.outer(np.arange(shape[0]) * 3, np.arange(shape[1]) * 2).reshape(
        *shape[:2], *[1] * (len(shape) - 2)
    )
    for image in (rng.integers(0, 256, shape), smooth % 256 + np.zeros(shape, int), np.full(shape, 255)):
        image = image.astype(np.uint8)
        write_png(tmp_path / "a.png", image)
        assert np.array_equal(decode((tmp_path / "a.png").read_bytes()).reshape(shape), image)


def test_png_of_a_rendered_picture(tmp_path: Path) -> None:
    vertices, faces = icosphere(2)
    image = render_mesh(vertices, faces, width=64, height=48)
    write_png(tmp_path / "a.png", image)
    assert np.array_equal(decode((tmp_path / "a.png").read_bytes()), image)
    assert (tmp_path / "a.png").stat().st_size < image.size / 2


def test_png_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OutputError, match="no folder"):
        write_png(tmp_path / "missing" / "a.png", np.zeros((2, 2, 3), np.uint8))
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    for bad in (np.zeros((2, 2, 3)), np.zeros((2, 2, 2), np.uint8), np.zeros((0, 2, 3), np.uint8)):
        with pytest.raises(ValueError, match="picture: need"):
            write_png(tmp_path / "a.png", bad)
    assert not (tmp_path / "a.png").exists()


def test_text_is_as_wide_as_it_says_and_lies_where_it_is_put() -> None:
    for text in ("Base mesh, 2,000 faces", "gjpqy|_", "1.25e-04 ± 3%", "é"):
        image = np.full((80, 500, 3), 255, np.uint8)
        draw_text(image, text, 250.3, 40.0, 12, align=0.5, color=(0, 0, 0))
        columns = np.flatnonzero((image < 128).any(axis=(0, 2)))
        width = text_width(text, 12)
        assert columns[0] == pytest.approx(250.3 - width / 2, abs=2.5)
        assert columns[-1] == pytest.approx(250.3 + width / 2, abs=2.5)
    image = np.full((80, 100, 3), 255, np.uint8)
    draw_text(image, "H", 20, 40.0, 24)
    rows = np.flatnonzero((image < 128).any(axis=(1, 2)))
    assert (rows[0], rows[-1]) == pytest.approx((28, 51), abs=2)


def test_text_outside_the_picture_is_cut_off() -> None:
    image = np.full((10, 10, 3), 255, np.uint8)
    for column, row in ((-5, 5), (8, 5), (3, -4), (3, 13), (500, 500), (-500, 0)):
        draw_text(image, "Wq", column, row, 12)
    assert image.shape == (10, 10, 3)


def test_every_printable_character_has_a_glyph_within_its_box() -> None:
    for code in range(32, 127):
        width, strokes = segments(chr(code))
        assert chr(code) in GLYPHS
        assert np.all(strokes >= 0)
        assert np.all(strokes[..., 0] <= width)
        assert len(strokes) or chr(code) == " "


def test_lines_break_at_blanks_and_lose_no_word() -> None:
    text = "one two three\nfour incomprehensibilities five"
    lines = wrap_text(text, 12, text_width("one two", 12))
    assert lines == ["one two", "three", "four", "incomprehensibilities", "five"]


def test_panels_hold_their_pictures_unchanged() -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 200, (h, w, 3)).astype(np.uint8) for h, w in ((40, 60), (50, 50), (30, 60), (20, 10))]
    page = panels(images, ["a", "", "b\nc", "d"], "a caption", columns=2, color_bar=ColorBar(0, 1e-3, "error"))
    windows = np.lib.stride_tricks.sliding_window_view(page, (1, 10, 3))[:, :, 0]
    for image in images:
        found = np.argwhere((windows == image[0, :10]).all(axis=(2, 3, 4)))
        assert len(found) == 1
        row, column = found[0]
        assert np.array_equal(page[row : row + image.shape[0], column : column + image.shape[1]], image)
    with pytest.raises(ValueError, match="a title for each, got 4, 1"):
        panels(images, ["a"])


def test_the_colour_bar_shows_its_map_with_the_largest_value_on_top() -> None:
    image = np.full((200, 50, 3), 255, np.uint8)
    page = panels([image], ["x"], color_bar=ColorBar(0, 1, "error", "turbo"))
    bar = page[:, 50 + 2 * 16 + 9].astype(int)
    low, high = (np.round(colormap(np.array([v]), 0, 1, "turbo")[0] * 255) for v in (0.02, 0.98))
    rows = [np.abs(bar - color).sum(axis=1).argmin() for color in (low, high)]
    assert rows[1] < rows[0]
    assert np.abs(bar[rows] - [low, high]).max() < 8


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"colors": np.zeros((5, 3))}, "one RGB row per vertex .8. or face .12., got .5, 3."),
        ({"width": 0}, "positive size"),
    ],
)
def test_bad_arguments_are_named(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        render_mesh(*cube(), **options)


def test_importing_the_renderer_imports_nothing_heavy() -> None:
    script = (
        "import sys, ndf_core.render\n"
        "heavy = {'torch', 'scipy', 'igl', 'open3d', 'trimesh', 'matplotlib', 'PIL', 'rich'}\n"
        "sys.exit(' '.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")

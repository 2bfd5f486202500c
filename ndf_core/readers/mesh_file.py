"""Any accepted mesh file to triangles."""

from __future__ import annotations

from pathlib import Path

from ndf_core.errors import InputError
from ndf_core.readers.detect import SUFFIXES, look
from ndf_core.readers.glb import read_glb
from ndf_core.readers.obj import read_obj
from ndf_core.readers.off import read_off
from ndf_core.readers.ply import read_ply
from ndf_core.readers.polygons import RawMesh
from ndf_core.readers.stl import read_ascii_stl, read_stl

MOST_BYTES = 4 << 30
_READERS = {
    "ply": read_ply,
    "stl": read_stl,
    "ascii stl": read_ascii_stl,
    "obj": read_obj,
    "off": read_off,
    "glb": read_glb,
}
_BY_SUFFIX = {".ply": read_ply, ".stl": read_stl, ".obj": read_obj, ".off": read_off, ".glb": read_glb}


def read_mesh_file(path: Path) -> RawMesh:
    """Read a mesh file by its content; its suffix only decides where the content shows nothing.

    Memory stays within a multiple of the file's size, whatever its header announces.

    Raises:
        InputError: the file cannot be read as a mesh, or has no triangles.
    """
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a directory, not a mesh file")
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"{path}: larger than {MOST_BYTES >> 30} GiB")
        content = look(path)
        reader = _READERS[content.format] if content.format else _BY_SUFFIX.get(path.suffix.lower())
        if reader is None:
            raise InputError(f"{path}: not a mesh file; {' '.join(SUFFIXES)} are read")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not data:
        raise InputError(f"{path}: the file is empty")
    try:
        mesh = reader(data)
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError) as error:
        # The last ones: JSON of a GLB with the wrong kinds of values in it.
        cause = str(error) if isinstance(error, ValueError) else f"its description is not valid glTF ({error!r:.80})"
        raise InputError(f"{path}: cannot be read as {content.format or path.suffix[1:]}: {cause}") from error
    if not len(mesh.faces):
        raise InputError(f"{path}: has {len(mesh.vertices):,} points but no triangles; a mesh is needed here")
    return mesh

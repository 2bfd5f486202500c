"""Fields from one asset to another over the same base mesh: a texture goes along with the map between two shapes."""

from __future__ import annotations

from dataclasses import replace

from ndf_core.asset.asset import Asset
from ndf_core.errors import AssetError

_OF_THE_SHAPE = ("displacement", "inverse")


def copy_field(source: Asset, target: Asset, name: str) -> Asset:
    """The target with the source's field of this name, in place of its own where it has one.

    Laws: at every point of the base mesh the field has the source's value, bit for bit; the shape stays.

    Raises:
        AssetError: the base meshes differ, or the source has no such field.
    """
    if source.content.base_mesh_blob != target.content.base_mesh_blob:
        raise AssetError("the two assets have different base meshes; fit one with --base-from the other")
    known = sorted(set(source.content.fields) - set(_OF_THE_SHAPE))
    if name not in known:
        raise AssetError(f"there is no learned field {name!r:.70} to copy; there is {', '.join(known) or 'none'}")
    fields = {**target.content.fields, name: source.content.fields[name]}
    return Asset(replace(target.content, fields=fields))

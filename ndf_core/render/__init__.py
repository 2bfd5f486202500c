"""Pictures of meshes as PNG files, without GPU, display or any dependency beyond numpy and our kernels."""

from ndf_core.render.camera import Camera
from ndf_core.render.colormap import colormap
from ndf_core.render.panels import ColorBar, panels
from ndf_core.render.png import write_png
from ndf_core.render.raycast import render_mesh

__all__ = ["Camera", "ColorBar", "colormap", "panels", "render_mesh", "write_png"]

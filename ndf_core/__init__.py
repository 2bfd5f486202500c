"""Mesh processing on surfaces that are not meshes (neural displacement fields over a coarse base mesh).

    surface = ndf_core.open("scan.ply")
    asset = ndf_core.fit(surface, faces=2000)
    asset.save("scan.ndf")
    mesh = ndf_core.load("scan.ndf").extract(edge_length=0.01)

Importing this package imports nothing else; `load` and extraction need neither torch nor any plugin.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    __version__: str
    from ndf_core.asset.asset import Asset
    from ndf_core.fitting.observer import Observer
    from ndf_core.interfaces import Surface

__all__ = ["__version__", "fit", "fit_field", "load", "open"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("ndf-core")
    raise AttributeError(f"module 'ndf_core' has no attribute {name!r}")


def open(source: str | Path | object, repr: str | None = None, **options: Any) -> Surface:
    """Open an input as a `Surface`, in its own units.

    Args:
        source: a file, ``"module:callable"``, or whatever Python object the representation takes.
        repr: name of the representation; without it the installed plugins look at the file.
        options: those of the representation (``ndf fit --repr NAME --help`` lists them); tables as nested mappings.

    Raises:
        RepresentationError: no representation of this name; or none, or more than one, recognises the source.
        PluginError: the representation's plugin cannot be used.
        ConfigError: one line for every option that is wrong.
        InputError: the source cannot be read as this representation.
    """
    from dataclasses import replace

    from ndf_core.config.resolve import resolve_representation
    from ndf_core.plugins.choosing import choose
    from ndf_core.plugins.loading import load as load_plugin
    from ndf_core.plugins.opening import open_surface

    choice = None if repr else choose(source)
    spec = choice.spec if choice else load_plugin(str(repr))
    surface = open_surface(spec, source, resolve_representation(spec, options))
    return replace(surface, notes=(*choice.warnings, choice.note, *surface.notes)) if choice else surface


def fit(
    surface: Surface,
    *,
    config: str | Path | None = None,
    output: str | Path | None = None,
    resume: bool = False,
    observer: Observer | None = None,
    **options: Any,
) -> Asset:
    """Fit a neural displacement field to `surface`.

    Args:
        config: a config file under `options`; only its ``[fit]`` table is used.
        output: where to write the asset; ``<output>.checkpoint`` is kept beside it while the fit runs.
        resume: go on from that checkpoint. The asset is the one that the uninterrupted run would have made.
        observer: told about stages and progress.
        options: fields of `FitConfig`, tables as nested mappings: ``faces=2000, loss={"cycle": 1e3}``. They lie over
            the surface's training defaults and the recipe.

    Raises:
        ConfigError: one line for every option that is wrong.
        BaseMeshError: no closed manifold base mesh can be made from the surface.
        FitError: the losses are not finite, or too few samples can be projected.
        ResumeError: the checkpoint belongs to another run or cannot be read.
        OutputError: `output` cannot be written.
    """
    from pathlib import Path

    from ndf_core.config.resolve import Given, resolve_config
    from ndf_core.fitting.pipeline import run_fit

    resolved = resolve_config(given=Given(options), file=config, training_defaults=surface.training_defaults)
    path = None if output is None else Path(output)
    return run_fit(surface, resolved.fit.config, output=path, resume=resume, observer=observer).asset


def fit_field(
    asset: Asset,
    values: Any,
    *,
    points: Any,
    faces: Any = None,
    name: str = "field",
    labels: Sequence[str] = (),
    threads: int = 1,
    **options: Any,
) -> Asset:
    """Learn a field on an asset's surface and return the asset with it (Sec. 3.5); ``asset.values(name, ...)`` is it.

    Args:
        asset: what the field is over.
        values: (n,), (n, k) or (n, k, c): one or more fields; a row for each point, or for each face.
        points: points near the surface, or with `faces` the vertices of a mesh of it; the input's units.
        faces: triangles between which values are linear.
        name: of the field in the asset.
        labels: names of the columns, or of the classes.
        threads: for closest points.
        options: fields of `FieldConfig`: ``kind="binary", feature_dim=8, hidden=32``.

    Raises:
        ConfigError: one line for every option that is wrong.
        InputError: values that cannot be learned.
    """
    from ndf_core.config.field import FieldConfig
    from ndf_core.config.resolve import resolve_options
    from ndf_core.fitting.field_fit import fit_field as learn
    from ndf_core.fitting.field_values import FieldValues

    config = resolve_options(FieldConfig, options, name="arguments")
    return learn(asset, FieldValues(points, values, faces), name, config, labels, threads).asset


def load(path: str | Path) -> Asset:
    """Read an asset.

    Raises:
        AssetError: the file is truncated, corrupted, or newer than this package.
        InputError: there is no such file.
    """
    from ndf_core.asset.asset import Asset

    return Asset.load(path)

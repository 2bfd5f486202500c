"""The entry module and the `RepresentationSpec` that it offers."""

from __future__ import annotations

from ndf_core.plugins.contract import RULES, Rule
from ndf_core.testing.check import Broken, Check, expect, law
from ndf_core.testing.subject import Subject

HEAVY = ("numpy", "torch", "scipy", "igl", "skimage", "trimesh", "open3d", "PIL", "pandas", "matplotlib", "rich")


@law()
def spec_can_be_had(subject: Subject) -> None:
    """Nothing works before the entry module imports and its hook answers."""
    if subject.entry.error:
        raise Broken(subject.entry.error)
    _ = subject.spec


def _contract(rule: Rule) -> Check:
    def kept(subject: Subject) -> None:
        fault = rule(subject.spec, subject.entry.name)
        expect(fault is None, fault or "")

    assert rule.__doc__
    return Check(rule.__name__, rule.__doc__, kept, (spec_can_be_had,))


CONTRACT = tuple(map(_contract, RULES))
"""What the loader demands."""


@law(spec_can_be_had)
def entry_module_is_light(subject: Subject) -> None:
    """It is imported to look at any file and for every help text."""
    loaded = subject.imported[1]
    heavy = [name for name in HEAVY if name in loaded]
    expect(
        not heavy, f"importing {subject.entry.target} imports {', '.join(heavy)}; move that to where it opens files"
    )


@law(spec_can_be_had)
def entry_module_prints_nothing(subject: Subject) -> None:
    """What plugins print would end up in other commands' output."""
    printed = subject.imported[0]
    expect(not printed, f"importing {subject.entry.target} prints {printed[:80]!r}")

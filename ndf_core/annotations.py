"""Array annotations of the modules that extraction imports.

jaxtyping takes 0.1 s to import, a tenth of extracting a mesh, and nothing evaluates an annotation but checks of
shapes, which import jaxtyping before anything else.
"""

import sys
from typing import TYPE_CHECKING, Any

__all__ = ["Float", "Int", "UInt8"]

if TYPE_CHECKING or "jaxtyping" in sys.modules:
    from jaxtyping import Float, Int, UInt8
else:

    class _Unchecked:
        def __class_getitem__(cls, _shape: object) -> Any:
            return Any

    Float = Int = UInt8 = _Unchecked

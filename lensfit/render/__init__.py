"""Lens and plate to frame, forward only.

`lensfit.render` is this room and, called, the function that it is about:
``lensfit.render(rgb, None, lens)`` is `lensfit.render.frame.render`.
"""

import sys
from types import ModuleType
from typing import Any


class _Room(ModuleType):
    """A package that can be called; what it calls is imported only then."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        from lensfit.render.frame import render

        return render(*args, **options)


sys.modules[__name__].__class__ = _Room

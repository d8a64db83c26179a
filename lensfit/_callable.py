"""Rooms that are also verbs: `lensfit.fit(...)` beside `lensfit.fit.solve`.

The public API promises `lensfit.fit(takes, ...)` and `lensfit.render(rgb, ...)`, and
the house has rooms of the same names. Python binds a subpackage to its parent's
attribute as soon as anything inside it is imported, so a plain function of that name
would come and go with import order. The package is made callable instead, and
delegates to its one function, imported at the first call.
"""

import importlib
import sys
from types import ModuleType
from typing import Any


def make_callable(package: str, module: str, function: str) -> None:
    """Let calling `package` mean calling `module.function`.

    Parameters
    ----------
    package : Name of an imported package, as its `__name__` says.
    module, function : Where the function is; imported when first called.
    """

    class CallableRoom(ModuleType):
        def __call__(self, *args: Any, **kwargs: Any) -> Any:
            return getattr(importlib.import_module(module), function)(*args, **kwargs)

    sys.modules[package].__class__ = CallableRoom

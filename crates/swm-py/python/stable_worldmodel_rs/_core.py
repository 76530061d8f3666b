"""The compiled module, as the rest of the package names it.

Type checkers let no module name another that begins with an underscore. This one does, for all others.
"""

from . import _swm as core  # pyright: ignore[reportPrivateUsage]  private to the package, not to one module

__all__ = ["core"]

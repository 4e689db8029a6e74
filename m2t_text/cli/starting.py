"""A quick start and end: no search for what is never used, and none for garbage in what has just been loaded.

Numba looks for SciPy's linear algebra, which takes a tenth of a command; collecting garbage while modules are
loaded takes another tenth, and once more at the end a quarter.
"""

import gc
import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from typing import Any

LOOKING = "numba.np.arraymath"  # the module that does, and
FOUND = "_HAVE_BLAS"  # what it has when it is done
LOADED = 300_000  # objects, twice what is made before a command works


class NoLinearAlgebra(MetaPathFinder):
    """Hides `scipy.linalg` from Numba while it looks for it, and from nobody else."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        looking = sys.modules.get(LOOKING)
        if fullname == "scipy.linalg" and looking is not None and not hasattr(looking, FOUND):
            raise ImportError("no compiled code of this program needs it", name=fullname)
        return None


def start_quickly() -> None:
    """To be called once, before anything is compiled."""
    gc.set_threshold(LOADED)
    sys.meta_path.insert(0, NoLinearAlgebra())


def end_quickly() -> None:
    """To be called last: what is left needs no collecting when the interpreter ends."""
    gc.freeze()

"""A quick start: Numba looks for SciPy's linear algebra, which takes a tenth of a command and is never used."""

import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from typing import Any

LOOKING = "numba.np.arraymath"  # the module that does, and
FOUND = "_HAVE_BLAS"  # what it has when it is done


class NoLinearAlgebra(MetaPathFinder):
    """Hides `scipy.linalg` from Numba while it looks for it, and from nobody else."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        looking = sys.modules.get(LOOKING)
        if fullname == "scipy.linalg" and looking is not None and not hasattr(looking, FOUND):
            raise ImportError("no compiled code of this program needs it", name=fullname)
        return None


def start_quickly() -> None:
    """To be called once, before anything is compiled."""
    sys.meta_path.insert(0, NoLinearAlgebra())

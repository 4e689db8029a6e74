"""How functions are compiled, and where what was compiled is kept.

Compiling takes seconds, once on each machine, so little is asked of the compiler: a kernel neither allocates
nor sorts nor assigns to slices, as each of these brings code of Numba's own along. It loops over arrays that
NumPy made and Python holds, so nobody has to count who uses them: counting took a tenth of a search's bounds.
Numbers that a kernel passes to an inner function are ``np.int64(0)``, not ``0``: the function is compiled once
for each type of its arguments, and a literal is a type of its own.
"""

import atexit
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs
from numba.core.caching import FunctionCache
from numba.core.runtime import rtsys

Function = TypeVar("Function", bound=Callable[..., Any])

PACKAGE = Path(__file__).parents[1]
KNOWN = numba.version_info.short in ((0, 68),)  # versions whose inner workings are relied upon for speed:
# compiled code needs nothing of the compiler, and references to arrays need not be counted
UNCOUNTED = {"_nrt": False} if KNOWN else {}
COMPILED = ("description", "index/kernels", "mapping", "recognition", "saved_maps")  # have compiled functions


class KernelCache(FunctionCache):
    """Numba's cache of one function. It loads machine code without what the compiler knows of Python,
    which takes a sixth of a command; compiling loads that."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        if not KNOWN:
            return super().load_overload(sig, target_context)
        rtsys.initialize(target_context)  # what machine code calls
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def kernel(function: Function) -> Function:
    """Compiles a function that Python calls, when it is first called; the machine code is kept on the disk."""
    return _kept(function, UNCOUNTED)


def allocating_kernel(function: Function) -> Function:
    """The same for a function that returns arrays of its own, for which compiling takes longer."""
    return _kept(function, {})


def inner(function: Function) -> Function:
    """Compiles a function that only compiled code calls, into its callers."""
    alone = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compiled: Function = numba.njit(nogil=True, **alone, **UNCOUNTED)(function)
    return compiled


def inlined(function: Function) -> Function:
    """The same for a function of a few lines: it becomes part of its callers before they are compiled."""
    compiled: Function = numba.njit(inline="always", **UNCOUNTED)(function)
    return compiled


def _kept(function: Function, options: dict[str, bool]) -> Function:
    """A function that is compiled when it is first called, and kept."""
    compiled: Any = numba.njit(nogil=True, **options)(function)
    chosen = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(kernel_folder())  # looked up as the cache is made, not later
    try:
        compiled._cache = KernelCache(function)
    finally:
        numba.config.CACHE_DIR = chosen
    result: Function = compiled
    return result


def kernel_folder() -> Path:
    """The folder in which this version's compiled kernels are kept; it can be written.

    It lies in the folder that NUMBA_CACHE_DIR names, else beside the package, else among the user's caches. If
    none of these can be written it is a temporary one, which ends with the process. What was compiled beside
    the package, when a container was built for one, is copied to wherever else the folder is.
    """
    return _folder()[0]


def are_kept() -> bool:
    """Whether what is compiled outlives the process."""
    return _folder()[1]


@cache
def _folder() -> tuple[Path, bool]:
    name, beside = f"kernels-{_version()}", PACKAGE / "__pycache__"
    places = [Path(numba.config.CACHE_DIR)] if numba.config.CACHE_DIR else [beside, _user_caches()]
    place = next(filter(_can_write, places), None)
    kept = place is not None
    if place is None:
        place = Path(tempfile.mkdtemp(prefix="m2t-text-"))
        atexit.register(_remove, place, os.getpid())
    if place == beside:
        for old in place.glob("kernels-*"):
            if old.name != name:  # of the package as it was
                shutil.rmtree(old, ignore_errors=True)
    elif (beside / name).is_dir() and not (place / name).exists():
        _copy(beside / name, place / name)
    return place / name, kept


def _version() -> str:
    """Changes with every source file that holds compiled functions: Numba looks at the outermost ones only."""
    digest = sha256()
    for folder in COMPILED:
        for file in sorted((PACKAGE / folder).glob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _user_caches() -> Path:
    return Path(platformdirs.user_cache_dir("m2t-text", appauthor=False))


def _can_write(folder: Path) -> bool:
    """Whether files can be made in a folder, which is made if need be."""
    if not folder.is_absolute():  # the user has no home
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _copy(source: Path, target: Path) -> None:
    """Copies a folder as a whole or, if another process is quicker, not at all. The copy can be written."""
    parts = Path(tempfile.mkdtemp(dir=target.parent))
    with suppress(OSError):
        for file in filter(Path.is_file, source.rglob("*")):
            copied = parts / file.relative_to(source)
            copied.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copied)
        parts.rename(target)
    shutil.rmtree(parts, ignore_errors=True)


def _remove(folder: Path, process: int) -> None:
    """Removes a temporary folder as the process ends that made it, and not as those end that it forked."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)

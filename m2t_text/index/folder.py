"""The folder of an index: making it, opening it, and telling it from anything else."""

import pickle
import re
import struct
from pathlib import Path
from typing import Any

from whoosh import index as whoosh_index

from m2t_text.config import Parameters
from m2t_text.errors import MapIndexError
from m2t_text.index.schema import FORMAT_VERSION, TextField, schema

OURS = re.compile(r"_?MAIN[_.].*")  # what Whoosh calls its files
CONTENTS = re.compile(r"_MAIN_([0-9]+)\.toc")
UNREADABLE = (  # whatever a file that is not an index makes Whoosh and pickle raise
    whoosh_index.IndexError,
    OSError,
    EOFError,
    pickle.UnpicklingError,
    struct.error,
    ArithmeticError,
    AssertionError,
    AttributeError,
    ImportError,
    LookupError,
    MemoryError,
    TypeError,
    ValueError,
)


def create_whoosh(folder: Path, parameters: Parameters) -> None:
    """A new Whoosh index in a folder that is made, is empty, or was left half made.

    Raises:
        MapIndexError: if the folder holds an index or anything else, or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if generation(folder) >= 0:
            raise MapIndexError(f"{folder} already holds an index; open it, or choose another folder")
        foreign = [name for name in names(folder) if not OURS.fullmatch(name)]
        if foreign:
            raise MapIndexError(f"{folder} holds other files, as {foreign[0]!r}; choose a folder of its own")
        whoosh_index.create_in(str(folder), schema(parameters))
    except OSError as error:
        raise MapIndexError(f"cannot make an index in {folder}: {error.strerror or error}") from error


def open_whoosh(folder: Path) -> tuple[Any, Parameters]:
    """The Whoosh index in a folder, and the parameters that it was made with.

    Raises:
        MapIndexError: if there is none, or it is of another kind or version.
    """
    if generation(folder) < 0:
        raise MapIndexError(f"no index in {folder}; make one with `m2t-text index`")
    try:
        whoosh = whoosh_index.open_dir(str(folder))
        field = dict(whoosh.schema.items()).get("text")
        if not isinstance(field, TextField):
            raise MapIndexError(f"the index in {folder} is not one of maps; choose another folder")
        if field.version != FORMAT_VERSION:
            raise MapIndexError(
                f"the index in {folder} has format {field.version}, this program reads {FORMAT_VERSION}; "
                "index the logs again into another folder"
            )
        return whoosh, field.parameters
    except UNREADABLE as error:
        reason = str(error) or type(error).__name__
        raise MapIndexError(f"the index in {folder} cannot be read ({reason}); index the logs again") from error


def sweep(folder: Path) -> None:
    """Removes tables of contents that killed writers left half written; Whoosh removes all else itself."""
    for file in folder.glob("_MAIN_*.toc.*"):
        file.unlink()


def names(folder: Path) -> list[str]:
    """The names of a folder's files, sorted."""
    return sorted(file.name for file in folder.iterdir())


def generation(folder: Path) -> int:
    """The number of the latest commit in a folder; -1 if it holds no index."""
    if not folder.is_dir():
        return -1
    matches = (CONTENTS.fullmatch(name) for name in names(folder))
    return max((int(match[1]) for match in matches if match), default=-1)

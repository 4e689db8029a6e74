"""Point clouds: one reader for all kinds of files."""

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from m2t_text.clouds.cloud import Cloud, to_cloud
from m2t_text.clouds.parts import WatchedFile
from m2t_text.clouds.pcd import read_pcd
from m2t_text.clouds.ply import read_ply
from m2t_text.clouds.tables import read_lines, read_npy
from m2t_text.errors import CloudError, PartError, clean
from m2t_text.util.files import opened, shown
from m2t_text.util.names import checked_name, dataset_name
from m2t_text.util.types import Floats, Progress

__all__ = ["READERS", "Cloud", "read_cloud"]

READERS: dict[str, Callable[[BinaryIO], Floats]] = {
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".npy": read_npy,
    ".xyz": read_lines,
    ".pts": read_lines,
    ".asc": read_lines,
    ".csv": read_lines,
}


def read_cloud(
    path: str | Path,
    name: str | None = None,
    height: tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> Cloud:
    """Read a point cloud in metres, z upwards; ``name`` defaults to ``dataset_name(path)``.

    A cloud of three dimensions is cut to a band of heights, by default to one above its floor. ``progress`` is
    called with the bytes of the file read so far and its size.
    Raises CloudError with one line that says what is wrong, where, and what to do.
    """
    file = Path(path)
    name = dataset_name(file) if name is None else checked_name(name)
    try:
        with opened(file, CloudError) as plain:
            points = READERS[file.suffix.lower()](WatchedFile(plain, progress))
        return to_cloud(name, points, height)
    except PartError as error:
        raise CloudError(clean(f"{shown(file)}: {error}")) from error

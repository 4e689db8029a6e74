"""The places of a drive as documents, each as soon as the drive has come so far, and how they are sent."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import parse
from m2t_text.errors import LogError
from m2t_text.live.survey import LiveSurvey
from m2t_text.logs.log import Log
from m2t_text.pipeline import describe
from m2t_text.util.types import Progress
from m2t_text.web.walls import Drawn

SPACING = 1.0  # m of travel from one place of a drive to the next
NUMBERS = ("travel", "pose", "viewpoint", "centre_of_gravity")


def described_places(log: Log, parameters: Parameters, progress: Progress | None = None) -> Iterator[Document]:
    """The places of a drive, SPACING apart, each as soon as the scans of its map are matched.

    They are among those of `describe_survey`. Raises LogError if the drive is too short for one.
    """
    survey, after, length = LiveSurvey(parameters, log.laser_pose), 0.0, parameters.mapping.run_length
    for done, scan in enumerate(log.scans, start=1):
        survey.add(scan)
        if progress:
            progress(done, len(log.scans))
        for local_map in survey.new_runs():
            if local_map.travel[0] >= after:
                after = local_map.travel[0] + SPACING
                yield describe(local_map, log.name, parameters)
    if not after:
        least = f"the {length:g} m of one map"
        raise LogError(f"{log.name}: the robot travels less than {least}; record a longer log")


def to_json(document: Document) -> dict[str, Any]:
    """A document as it is sent."""
    return {
        "dataset": document.dataset,
        "first_scan": document.first_scan,
        "last_scan": document.last_scan,
        "points": document.points,
        "text": str(document.text),
        **{name: getattr(document, name).tolist() for name in NUMBERS},
    }


def from_message(message: dict[str, Any]) -> Document:
    """The document that `to_json` wrote."""
    arrays = {name: np.array(message[name], dtype=float) for name in NUMBERS}
    return Document(
        dataset=str(message["dataset"]),
        first_scan=int(message["first_scan"]),
        last_scan=int(message["last_scan"]),
        points=int(message["points"]),
        text=parse(message["text"]),
        **arrays,
    )


def image_to_json(drawn: Drawn) -> dict[str, Any]:
    """A saved map's image as it is sent."""
    header, columns = drawn
    sent = {name: [column.dtype.str, column.tolist()] for name, column in columns.items()}
    return {"header": header, "columns": sent}


def image_from_message(message: dict[str, Any]) -> Drawn:
    """The image that `image_to_json` wrote."""
    columns = {name: np.array(values, dtype=kind) for name, (kind, values) in message["columns"].items()}
    return message["header"], columns

"""The places of a drive as documents, each as soon as the drive has come so far, and how they are sent."""

from collections.abc import Iterator
from functools import partial
from time import monotonic
from typing import Any

import numpy as np

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.text import parse
from m2t_text.errors import LogError
from m2t_text.logs.log import Log
from m2t_text.mapping.free_space import Beams
from m2t_text.mapping.local_map import Survey, local_maps, run_starts
from m2t_text.mapping.trajectory import hits, refined_poses
from m2t_text.pipeline import describe
from m2t_text.util.types import Progress

SPACING = 1.0  # m of travel from one place of a drive to the next
PATIENCE = 0.4  # s from one look at how far a drive has come to the next
NUMBERS = ("travel", "pose", "viewpoint", "centre_of_gravity")


def places_of(log: Log, parameters: Parameters, progress: Progress | None = None) -> Iterator[Document]:
    """The places of a drive, SPACING apart, each as soon as the scans of its map are matched.

    They are those of `describe_survey`: what is known of a run does not change when the drive goes on.
    """
    mapping = parameters.mapping
    survey_of = partial(Survey, *hits(log, mapping.range_limit), beams=Beams.of(log, mapping.range_limit))
    poses: list[Any] = []
    last, looked = -1, monotonic()
    for pose in refined_poses(log):
        poses.append(pose)
        done = len(poses)
        if progress:
            progress(done, len(log.scans))
        if done < len(log.scans) and monotonic() - looked < PATIENCE:
            continue
        survey = survey_of(np.array(poses), log.cuts[log.cuts < done])
        begun = run_starts(survey, mapping.run_length, SPACING)
        for local_map in local_maps(survey, mapping, begun[begun > last]):
            yield describe(local_map, log.name, parameters)
            last = local_map.first_scan
        looked = monotonic()
    if last < 0:
        least = f"the {mapping.run_length:g} m of one map"
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

"""Compiles what commands need before they need it: once on each machine.

What is compiled for one purpose is a group of steps, each of which runs compiled functions on tiny data. New
compiled functions need nothing but a step here, and none if a step runs them already.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache, partial
from typing import Any, Literal

import numpy as np

from m2t_text.config import PROFILES, MatchingParameters
from m2t_text.description.text import Text
from m2t_text.index.kernels.packed import Texts
from m2t_text.index.search.collection import Collection, SegmentTexts
from m2t_text.index.search.scorers import BagScorer
from m2t_text.index.search.weighting import MapWeighting
from m2t_text.logs.log import Log, Scan
from m2t_text.mapping.scan_cloud import scan_cloud
from m2t_text.mapping.trajectory import survey
from m2t_text.mapping.wide_search import register_widely
from m2t_text.pipeline import describe_survey
from m2t_text.recognition.raster import Raster
from m2t_text.recognition.symmetry import other_poses
from m2t_text.recognition.verification import align
from m2t_text.util.compiled import Group, compile_once, missing
from m2t_text.util.types import Progress

ROOM = (6.0, 4.0)  # m; where the robot of the tiny log drives
TINY = 64  # keypoints of a text


def warm(groups: Iterable[Group], progress: Progress | None = None) -> None:
    """Compiles what is missing of the groups, or waits until another process that is at it has done so.

    ``progress`` is called with (steps done, steps in all).
    """
    chosen = missing(groups)
    total, before = sum(len(STEPS[group]) for group in chosen), 0
    for group in chosen:
        tell = partial(_tell, progress, before, total)
        compile_once(group, STEPS[group], tell)
        before += len(STEPS[group])


def _tell(progress: Progress | None, before: int, total: int, done: int) -> None:
    if progress is not None:
        progress(before + done, total)


@cache
def _log() -> Log:
    """Four scans of a drive through an empty room."""
    angles = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    scans = []
    for k in range(4):
        x, y = 2.0 + 0.2 * k, 2.0
        with np.errstate(divide="ignore"):
            to_x = np.where(np.cos(angles) > 0, ROOM[0] - x, -x) / np.cos(angles)
            to_y = np.where(np.sin(angles) > 0, ROOM[1] - y, -y) / np.sin(angles)
        scans.append(Scan(np.minimum(to_x, to_y), angles, np.array([x, y, 0.0])))
    return Log("warm-up", tuple(scans))


def _match_scans() -> None:
    survey(_log(), PROFILES["default"].mapping)


def _describe(profile: str) -> None:
    parameters = PROFILES[profile]
    mapping = replace(parameters.mapping, run_length=0.3)
    found = list(describe_survey(survey(_log(), mapping), "warm-up", replace(parameters, mapping=mapping)))
    assert found


@cache
def _text() -> Text:
    along = np.arange(TINY)
    return Text.of(along % 16 - 8, along // 16 - 2, along % 7)


@cache
def _texts() -> Texts:
    return Texts.of([_text(), _text().turned(1)])


@cache
def _scorer(score: Literal["agreement", "intersection"]) -> Any:
    return MapWeighting.of(MatchingParameters(score=score)).text_scorer(_text(), _whole())


@cache
def _whole() -> Collection:
    return Collection({"": SegmentTexts(_texts(), np.ones(2, dtype=np.bool_))}, 2)


def _score(score: Literal["agreement", "intersection"], verb: str, *threshold: float) -> None:
    getattr(_scorer(score), verb)("", np.arange(2), *threshold)


def _align() -> None:
    raster, best = Raster.of(_text(), 0.1), align(_text(), [_text()], 0.1)[0]
    other_poses(raster, raster, best.pose)


def _match_widely() -> None:
    cloud = scan_cloud(_log().scans[0], np.zeros(3))
    register_widely(cloud.points, cloud.normals, cloud.points, 0.2, 0.1, np.array([0.1, 0.05]))


def _draw_and_sample() -> None:
    from m2t_text.saved_maps.occupancy_mapping import build_map  # SciPy takes as long to load as some kernels
    from m2t_text.saved_maps.sampling import Sampler  # to compile, and no other step needs it

    scans, mapping = _log().scans, PROFILES["default"].mapping
    grid = build_map(_log(), np.array([scan.odometry for scan in scans]), np.arange(len(scans)))
    sampler = Sampler.of(grid, mapping)
    list(sampler.local_maps(sampler.views(), np.arange(1)))


STEPS: dict[Group, tuple[Callable[[], object], ...]] = {
    Group.DESCRIBING: (_match_scans, partial(_describe, "paper"), partial(_describe, "default")),
    Group.BOUNDS: (
        partial(_score, "agreement", "estimate"),
        partial(_score, "agreement", "bound", 0.5),
        partial(_score, "agreement", "fine_bound", 0.5),
    ),
    Group.AGREEMENT: (partial(_score, "agreement", "score"),),
    Group.INTERSECTION: (
        partial(_score, "intersection", "bound", 0.5),
        partial(_score, "intersection", "score"),
        lambda: BagScorer(_text(), _whole(), weighted=False).score("", np.arange(2)),
    ),
    Group.SIEVING: (
        partial(_score, "agreement", "unlikeness"),
        partial(_score, "agreement", "may_reach", 0.5),
    ),
    Group.VERIFICATION: (_align,),
    Group.MAPPING: (_match_widely, _draw_and_sample),
}

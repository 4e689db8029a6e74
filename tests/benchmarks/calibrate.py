"""Fits the coefficients of the verdict's probability: `make calibrate LOGS="a.log b.log.gz"`.

Maps of logs with corrected poses and of simulated buildings are looked up in their own index, as `search` does:
places that were visited before, places that were not, and places all of whose maps are taken out. The ground
truth says which answers are right. The coefficients are fitted with each source left out in turn, which gives
the figures printed for it, and then on all sources. Those in force (m2t_text/recognition/verdict.py) are judged
beside them: of fits that do about equally well they are one that asks more of an answer's own fit.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from whoosh.query import Not, Or, Term

from m2t_text.config import PROFILES
from m2t_text.evaluation.protocol import APART, UNVISITED, GroundTruth, draw
from m2t_text.index.map_index import MapIndex
from m2t_text.logs import Log, read_log
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.pipeline import describe_log
from m2t_text.recognition import verdict
from m2t_text.recognition.finding import VERIFIED, verify_hits
from m2t_text.recognition.found import Found, strongest
from m2t_text.recognition.queries import Query
from m2t_text.recognition.raster import Raster
from m2t_text.recognition.symmetry import other_poses
from m2t_text.util.workers import cores, mapped

Floats = NDArray[np.float64]

KINDS = ("visited", "unvisited", "taken out")
SIMULATED = 0.4  # weight of a simulated building beside a log
IN_FORCE = np.array(
    [
        verdict.LEAD,
        verdict.OWN,
        verdict.WITH_FREE.overlap,
        verdict.WITH_FREE.inliers,
        verdict.WITH_FREE.conflicts,
        verdict.WITH_FREE.constant,
    ]
)
SCALE = np.array([1.0, 1.0, 10.0, 10.0, 100.0, 10.0])  # of the coefficients, in the fit
BOUNDS = [(0, None), (0.1, 10), (0, None), (0, None), (None, 0), (None, None)]


@dataclass(frozen=True)
class Answers:
    """What became of the queries of one source.

    Attributes:
        kind: (Q,) number of the query's kind.
        right: (Q,) whether the first answer's pose is.
        figures: (Q, 4) lead, and shares of overlap, inliers and conflicts.
        weight: of the source in the fit.
    """

    kind: NDArray[np.int64]
    right: NDArray[np.bool_]
    figures: Floats
    weight: float


def answers_of(log: Log, count: int, weight: float, jobs: int) -> Answers:
    """Looks up so many maps of each kind, at most."""
    assert log.ground_truth is not None
    with TemporaryDirectory(prefix="m2t-text-") as folder:
        index = MapIndex.create(Path(folder) / "index", PROFILES["default"])
        index.replace(log.name, describe_log(log, PROFILES["default"], jobs))
        truth = GroundTruth.of(index.documents(), log.ground_truth)
        visited, unvisited = truth.queries(), truth.unvisited()
        tasks = [(0, int(k)) for k in draw(visited, count, 0)]
        tasks += [(1, int(k)) for k in draw(unvisited, count, 1)]
        tasks += [(2, int(k)) for k in draw(visited, count // 2, 2)]
        rows = [row for row in mapped(partial(_looker, index.path, truth), tasks, jobs) if row is not None]
    table = np.array(rows).reshape(-1, 6)
    return Answers(table[:, 0].astype(int), table[:, 1] > 0, table[:, 2:], weight)


def _looker(path: Path, truth: GroundTruth) -> "partial[tuple[float, ...] | None]":
    return partial(_looked_up, MapIndex.open(path), truth)


def _looked_up(index: MapIndex, truth: GroundTruth, task: tuple[int, int]) -> tuple[float, ...] | None:
    kind, k = task
    ids, cell = index.ids, index.parameters.mapping.cell
    query = Query.of(index.document(ids[k]))
    near = [Term("map_id", ids[i]) for i in np.flatnonzero(truth.distances(k) <= UNVISITED)]
    hits = index.search(
        query.text, VERIFIED, query.excluding(APART), filter=Not(Or(near)) if kind == 2 else None, texts=True
    )
    if not hits:
        return None
    verified = verify_hits(index, query, hits)
    best = verified[0]
    assert best.alignment is not None and best.pose is not None
    rasters = Raster.of(query.text, cell), Raster.of(index.document(best.hit.map_id).text, cell)
    turned = [Found(best.hit, None, other) for other in other_poses(*rasters, best.alignment.pose)]
    rival, fit = strongest(best, [*verified, *turned]), best.alignment.fit
    right = truth.right(k, ids.index(best.hit.map_id), best.pose)
    overlap = fit.seen / max(fit.keypoints, 1)
    return kind, right, verdict.lead(rival), overlap, fit.seen_inliers, fit.seen_conflicts


def odds(coefficients: Floats, figures: Floats) -> Floats:
    """(Q,) of the answers being right, on a logarithmic scale, as in `verdict.probability`."""
    lead, own, *shares, constant = coefficients
    return lead * figures[:, 0] - own * np.logaddexp(0, -(figures[:, 1:] @ np.array(shares) + constant))


def fitted(sources: list[Answers]) -> Floats:
    """The coefficients that make the answers of all sources most likely."""

    def loss(scaled: Floats) -> float:
        total = 1e-5 * float(scaled @ scaled)
        for one in sources:
            sign = np.where(one.right, -1.0, 1.0)
            total += one.weight * np.logaddexp(0, sign * odds(scaled * SCALE, one.figures)).mean()
        return total

    bounds = [tuple(None if b is None else b / s for b in pair) for pair, s in zip(BOUNDS, SCALE, strict=True)]
    return np.asarray(minimize(loss, IN_FORCE / SCALE, method="L-BFGS-B", bounds=bounds).x) * SCALE


def judged(coefficients: Floats, one: Answers, sure: float) -> str:
    """Precision and recall of `match`, and the wrong ones where the place is not in the index."""
    match = odds(coefficients, one.figures) >= np.log(sure / (1 - sure))
    visited, right = one.kind == 0, one.right & match
    judged_by = match & (one.kind < 2)
    precision = 100 * (right & visited).sum() / max(judged_by.sum(), 1)
    wrong = " ".join(f"{(match & ~one.right & (one.kind == k)).sum()}/{(one.kind == k).sum()}" for k in (1, 2))
    return f"{precision:6.1f} {100 * (right & visited).sum() / max(visited.sum(), 1):6.1f}   {wrong:>10}"


def sources(logs: list[Path], simulated: int) -> Iterator[tuple[str, Log, float]]:
    for path in logs:
        yield path.name, read_log(path), 1.0
    for k in range(simulated):
        beams = 360 if k % 3 == 0 else 180
        length = (44.0, 60.0, 36.0, 52.0)[k % 4]
        asked = Simulation(seed=200 + k, drive=k, length=length, travel=240.0, step=0.3, beams=beams)
        yield f"simulated {k}", simulate(asked), SIMULATED


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, help="logs with corrected poses")
    parser.add_argument("--simulated", type=int, default=4, help="number of simulated buildings")
    parser.add_argument("--queries", type=int, default=150, help="maps of each kind looked up, at most")
    parser.add_argument("--sure", type=float, default=0.9, help="probability of a `match` in the fits")
    options = parser.parse_args()
    answers: dict[str, Answers] = {}
    for name, log, weight in sources(options.logs, options.simulated):
        answers[name] = answers_of(log, options.queries, weight, cores(None))
        print(f"looked up {name}: {len(answers[name].right)} maps", flush=True)
    print(f"\n{'source':28} {'left out: match right, found, wrong u/t':>40} {'in force':>28}")
    for name, one in answers.items():
        others = [other for other in answers if other != name]
        left_out = fitted([answers[other] for other in others] or [one])
        print(f"{name:28} {judged(left_out, one, options.sure):>40} {judged(IN_FORCE, one, verdict.SURE):>28}")
    print(
        "\n"
        + " ".join(f"{name:>10}" for name in ("lead", "own", "overlap", "inliers", "conflicts", "constant"))
    )
    for name, coefficients in (("fitted", fitted(list(answers.values()))), ("in force", IN_FORCE)):
        print(" ".join(f"{value:10.2f}" for value in coefficients), name)


if __name__ == "__main__":
    main()

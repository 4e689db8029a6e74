"""The logs and simulated buildings on which the verdict's coefficients are fitted, looked up."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from lookups import Lookups, Source, in_other_logs, in_saved_map, sequences, visits

from m2t_text.config import PROFILES
from m2t_text.logs import Log, read_log
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.mapping.trajectory import survey
from m2t_text.util.geometry import between, compose


def all_lookups(logs: Sequence[str], simulated: int, count: int, folder: Path) -> Iterator[Lookups]:
    """Of all sources. What a folder holds is taken from there, and it gets what is missing.

    Args:
        logs: paths, or RAW=CORRECTED.
        simulated: number of simulated buildings.
        count: queries of visited places of a log, at most; a fifth of it of all else.
        folder: which is made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    real, few = [_source_of(path) for path in logs], count // 5
    whole = [one for one in real if one.name == one.building]
    for one in real:
        twin = one.name != one.building
        yield _kept(folder, one, "visits", partial(visits, one, folder, few if twin else count))
    for one in whole:
        if len(whole) > 1:
            yield _kept(folder, one, "others", partial(in_other_logs, one, whole, folder, few))
        yield _kept(folder, one, "saved", partial(in_saved_map, one, few))
    for k in range(simulated):
        one = Source(f"simulated-{k}", f"simulated-{k}", partial(_simulated, k))
        yield _kept(folder, one, "visits", partial(visits, one, folder, few))


def all_sequences(logs: Sequence[str], count: int, folder: Path) -> Iterator[Lookups]:
    """Of all logs, a fifth of ``count`` queries each; arguments as for `all_lookups`."""
    for one in map(_source_of, logs):
        if one.name == one.building:
            yield _kept(folder, one, "sequences", partial(sequences, one, folder, count // 5))


def _kept(folder: Path, source: Source, part: str, look: Callable[[], Lookups]) -> Lookups:
    path = folder / f"{source.name}.{part}.npz"
    if not path.exists():
        look().save(path)
    found = Lookups.load(path)
    print(f"{source.name}, {part}: {len(found.kind)} queries", flush=True)
    return found


def _source_of(path: str) -> Source:
    raw, _, corrected = path.partition("=")
    names = [Path(one).name.removesuffix(".gz").removesuffix(".log") for one in (raw, corrected or raw)]
    return Source(
        names[0], names[1], partial(_read, names[0], Path(raw), Path(corrected) if corrected else None)
    )


def _read(name: str, raw: Path, corrected: Path | None) -> Log:
    log = replace(read_log(raw), name=name)
    return log if corrected is None else with_truth_of(log, read_log(corrected))


def _simulated(k: int) -> Log:
    """Buildings, lasers and drives as different as real ones."""
    asked = Simulation(
        seed=200 + k,
        drive=k,
        length=(44.0, 60.0, 36.0, 52.0)[k % 4],
        travel=240.0,
        step=0.3,
        beams=(360, 180)[k % 2],
        range_limit=(80.0, 80.0, 20.0, 8.0)[k % 4],
        doors=(2, 6)[k % 2],
        people=(1, 0, 3)[k % 3],
    )
    log, every = simulate(asked), (1, 3, 2)[k % 3]
    assert log.ground_truth is not None
    name = f"simulated-{k}"
    return replace(log, name=name, scans=log.scans[::every], ground_truth=log.ground_truth[::every])


def with_truth_of(log: Log, corrected: Log) -> Log:
    """The part of a log that another one, which holds some of its scans, gives ground truth.

    In between the robot moved as scan matching says, and what that errs is spread over the scans.
    """
    assert corrected.ground_truth is not None
    places: dict[bytes, list[int]] = {}
    for k, scan in enumerate(log.scans):
        places.setdefault(np.round(scan.ranges, 2).tobytes(), []).append(k)
    at, poses = [-1], []
    for scan, pose in zip(corrected.scans, corrected.ground_truth, strict=True):
        later = [k for k in places.get(np.round(scan.ranges, 2).tobytes(), []) if k > at[-1]]
        if later:
            at.append(later[0])
            poses.append(pose)
    inside = slice(at[1], at[-1] + 1)
    part = replace(log, scans=log.scans[inside])
    known, moved = np.array(at[1:]) - at[1], survey(part, PROFILES["default"].mapping).trajectory
    truth = [poses[0][None]]
    for begin, end, first, last in zip(known, known[1:], poses, poses[1:], strict=False):
        walk = compose(first, between(moved[begin], moved[begin + 1 : end + 1]))
        share = np.arange(1, len(walk) + 1)[:, None] / len(walk)
        truth.append(compose(walk, share * between(walk[-1], last)))
    return replace(part, ground_truth=np.concatenate(truth))

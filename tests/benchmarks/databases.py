"""Databases of any size, of the maps of real logs: each again and again, as another visit would see it."""

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from m2t_text.config import Parameters
from m2t_text.description.document import Document
from m2t_text.description.free_squares import FreeSquares
from m2t_text.description.text import Text
from m2t_text.index.map_index import MapIndex
from m2t_text.pipeline import view_text
from m2t_text.util.geometry import inverse, transform
from m2t_text.util.workers import cores, follow_parent

MISSED, CLUTTER = 0.1, 0.03  # shares of a map's keypoints that are not seen again, and that are new
JITTER = 0.03  # m; standard deviation of each point
VIEWPOINT = (0.2, 0.2, np.radians(1.0))  # m, m, rad; standard deviations of the planned viewpoint
STRETCH = 10.0  # m of travel; maps nearer than this were seen on one visit
CHUNK = 64


def seen_again(text: Text, parameters: Parameters, rng: np.random.Generator) -> Text:
    """What a robot would tell of the same place another time, described from the points anew."""
    cell = parameters.mapping.cell
    points = text.positions() * cell
    low, high = points.min(axis=0), points.max(axis=0)
    clutter = rng.uniform(low, high, (int(CLUTTER * len(points)), 2))
    points = points[rng.random(len(points)) >= MISSED] + 0.0
    points = np.concatenate([points + rng.normal(0.0, JITTER, points.shape), clutter])
    pose = rng.normal(0.0, VIEWPOINT)
    return view_text(transform(inverse(pose), points), parameters.description, cell)


def database(base: MapIndex, maps: int, folder: Path) -> MapIndex:
    """An index of so many maps in a folder, made unless it is there: those of ``base``, then as seen again."""
    name = folder / f"{base.parameters.profile}-{maps}"
    if name.is_dir() and len(MapIndex.open(name)) == maps:
        return MapIndex.open(name)
    index = MapIndex.create(name, base.parameters)
    index.replace("visits", visits(base, maps), drive=(maps, float(maps)))
    return index


def visits(base: MapIndex, maps: int) -> Iterator[Document]:
    """The documents of a database, evenly from all of the base."""
    texts = [document.text for document in base.documents() if len(document.text)]
    chosen = _shown(len(texts), maps)
    chunks = [np.arange(k, min(k + CHUNK, maps)) for k in range(0, maps, CHUNK)]
    document = next(base.documents())
    with ProcessPoolExecutor(cores(None), initializer=follow_parent) as pool:
        jobs = ((chunk, [texts[int(chosen[k])] for k in chunk], base.parameters) for chunk in chunks)
        for chunk, found in zip(chunks, pool.map(_described, jobs), strict=True):
            for number, text in zip(chunk.tolist(), found, strict=True):
                travel = np.array([number, number + 3.0])
                yield replace(
                    document, dataset="visits", first_scan=number, last_scan=number, travel=travel, text=text
                )


def mirrored(base: MapIndex, folder: Path) -> MapIndex:
    """An index, made unless it is there, of the base and of its mirror image: twice as many buildings."""
    name = folder / f"{base.parameters.profile}-mirrored"
    if name.is_dir() and len(MapIndex.open(name)) == 2 * len(base):
        return MapIndex.open(name)
    index = MapIndex.create(name, base.parameters)
    with index.writer() as writer:
        for dataset in base.datasets():
            drive, image = (dataset.scans, dataset.travel), f"{dataset.name}-mirrored"
            writer.replace(dataset.name, base.documents(dataset.name), drive)
            documents = base.documents(dataset.name)
            writer.replace(image, (mirror_image(one, image, base.parameters) for one in documents), drive)
    return index


def mirror_image(document: Document, dataset: str, parameters: Parameters) -> Document:
    """A map with left and right changed, described anew."""
    text, free, cell = document.text, document.text.free, parameters.mapping.cell
    seen = view_text(text.positions() * [cell, -cell], parameters.description, cell)
    squares = FreeSquares.of(free.wx, -free.wy.astype(np.int64) - free.size, free.size)
    return replace(
        document,
        dataset=dataset,
        pose=document.pose * [1, -1, -1],
        viewpoint=document.viewpoint * [1, -1, -1],
        centre_of_gravity=document.centre_of_gravity * [1, -1],
        text=replace(seen, free=squares),
    )


def _shown(places: int, maps: int) -> np.ndarray:
    """Of which map of the base each map of a database is a visit."""
    return np.linspace(0, places - 1, maps).astype(int) if maps <= places else np.arange(maps) % places


def other_visits(base: MapIndex, count: int, maps: int) -> Iterator[tuple[Text, np.ndarray]]:
    """Queries, and which maps of a database (``maps``,) each may find: none of the same stretch of its drive,
    so that its place is there only where the robot came by another time."""
    documents = [document for document in base.documents() if len(document.text)]
    datasets = np.array([document.dataset for document in documents])
    middles = np.array([document.middle for document in documents])
    shown, rng = _shown(len(documents), maps), np.random.default_rng(10**9)
    for number in np.linspace(0, len(documents) - 1, count).astype(int).tolist():
        same = (datasets == datasets[number]) & (np.abs(middles - middles[number]) <= STRETCH)
        yield seen_again(documents[number].text, base.parameters, rng), ~same[shown]


def _described(job: tuple[np.ndarray, list[Text], Parameters]) -> list[Text]:
    numbers, texts, parameters = job
    return [
        seen_again(text, parameters, np.random.default_rng(number))
        for number, text in zip(numbers.tolist(), texts, strict=True)
    ]


def queries(base: MapIndex, count: int) -> list[Text]:
    """Maps of the base, evenly chosen, as seen once more."""
    ids = base.ids
    chosen = [ids[int(place)] for place in np.linspace(0, len(ids) - 1, count)]
    rng = np.random.default_rng(10**9)
    texts = [base.document(map_id).text for map_id in chosen]
    return [seen_again(text, base.parameters, rng) for text in texts if len(text)]

"""How sure a pose is: carried to another frame as small errors are, large where nothing holds, and honest."""

from pathlib import Path

import numpy as np

from m2t_text.description.text import Text
from m2t_text.index.map_index import MapIndex
from m2t_text.recognition.covariance import carried, dataset_covariance, fit_covariance
from m2t_text.recognition.raster import Shape
from m2t_text.recognition.verification import align
from m2t_text.util.geometry import compose, wrap


def test_a_covariance_is_carried_as_small_errors_are() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(0.0, 1.0, (3, 3)) * [0.01, 0.02, 0.005]
    covariance = root.T @ root
    pose, further = np.array([3.0, -2.0, 0.7]), np.array([-1.5, 4.0, 2.0])
    errors = rng.multivariate_normal(np.zeros(3), covariance, 200_000)
    reached = compose(compose(pose, errors), further) - compose(pose, further)
    reached[:, 2] = wrap(reached[:, 2])
    assert np.allclose(np.cov(reached.T), carried(covariance, pose, further), rtol=0.05, atol=2e-6)


def corridor(ends: bool) -> Text:
    """Two walls of 8 m along x, and if there are ends one across them."""
    along = np.arange(-40, 40)
    x, y = np.concatenate([along, along]), np.concatenate([np.full(80, 10), np.full(80, -10)])
    if ends:
        x, y = np.concatenate([x, np.full(19, 40)]), np.concatenate([y, np.arange(-9, 10)])
    return Text.of(x, y, np.zeros(len(x)))


def test_nothing_holds_a_pose_along_a_corridor() -> None:
    """Nor is a matrix inverted that cannot be."""
    for ends in (False, True):
        shape = Shape.of(corridor(ends), 0.1)
        sigma = np.sqrt(np.diag(fit_covariance(shape, shape, np.zeros(3))))
        assert sigma[1] < 0.06 and (sigma[0] < 0.1 if ends else sigma[0] > 3.0)
    nothing = Shape.of(Text.of([], [], []), 0.1)
    one = Shape.of(Text.of([0], [0], [0]), 0.1)
    assert np.isfinite(fit_covariance(one, one, np.zeros(3))).all()
    assert np.isfinite(fit_covariance(nothing, one, np.zeros(3))).all()


def test_errors_are_as_large_as_they_are_said_to_be(simulated_index: Path) -> None:
    """Of neighbouring maps of one drive, whose relative pose is known well."""
    index = MapIndex.open(simulated_index)
    documents = list(index.documents())
    squared = []
    for query, found in zip(documents[10::9], documents[4::9], strict=False):
        alignment = align(query.text, [found.text], 0.1)[0]
        if alignment.inlier_ratio < 0.7:
            continue
        viewpoint = compose(compose(found.pose, found.viewpoint), alignment.pose)
        error = viewpoint - compose(query.pose, query.viewpoint)
        error[2] = wrap(error[2])
        loose = carried(
            fit_covariance(*(Shape.of(one.text, 0.1) for one in (query, found)), alignment.pose),
            viewpoint,
            np.zeros(3),
        )
        squared.append(error @ np.linalg.solve(loose, error))
        whole = dataset_covariance(query, found, alignment, 0.1)
        assert (whole == whole.T).all() and np.linalg.eigvalsh(whole).min() > 0
    assert len(squared) > 8 and np.mean(np.array(squared) < 16.3) > 0.9

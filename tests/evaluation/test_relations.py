"""The SLAM benchmark's metric, by hand; and what is no file of relations."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from m2t_text.errors import SourceError
from m2t_text.evaluation.relations import Relations, published, read_relations, relation_errors
from m2t_text.logs.log import Log, Scan

NOTHING = np.empty(0)
TIMES = [0.0, 1.0, 3.0, 2.0]  # that of the last runs backwards
LOG = Log("drive", tuple(Scan(NOTHING, NOTHING, np.zeros(3), time) for time in TIMES))
TRAJECTORY = np.array([[0.0, 0, np.pi / 2], [0, 1, np.pi / 2], [0, 3, np.pi], [0, 2, np.pi / 2]])


def test_errors_by_hand():
    times = np.array([[0.1, 0.9], [2.0, 3.0], [0.0, 9.0]])
    poses = np.array([[1.0, 0, 0], [1.0, 0.3, np.pi / 2 + 0.1], [0, 0, 0]])
    errors = relation_errors(LOG, TRAJECTORY, Relations(times, poses))
    assert (errors.relations, errors.left_out) == (2, 1)
    assert errors.translation == pytest.approx((0.15, 0.15))
    assert errors.translation_squared == pytest.approx((0.045, 0.045))
    off = np.degrees(0.1)
    assert errors.rotation == pytest.approx((off / 2, off / 2))
    assert errors.rotation_squared == pytest.approx((off**2 / 2, off**2 / 2))


def test_the_error_does_not_depend_on_the_frame_of_the_trajectory():
    relations = Relations(np.array([[0.0, 3.0]]), np.array([[3.1, 0.2, 1.5]]))
    c, s = np.cos(2.0), np.sin(2.0)
    turned = np.column_stack([TRAJECTORY[:, :2] @ [[c, s], [-s, c]] + [5, -7], TRAJECTORY[:, 2] + 2.0])
    one, other = (relation_errors(LOG, poses, relations) for poses in (TRAJECTORY, turned))
    assert one.translation == pytest.approx(other.translation)
    assert one.rotation == pytest.approx(other.rotation)


def test_relations_of_another_log_are_told():
    with pytest.raises(SourceError, match="drive: no relation has scans at its times"):
        relation_errors(LOG, TRAJECTORY, Relations(np.array([[7.0, 8.0]]), np.zeros((1, 3))))


def test_a_file_plain_or_gzipped(tmp_path: Path):
    text = "# t1 t2 x y z roll pitch yaw\n\n1 2 0.5 -0.25 0 0 0 0.125\n"
    (tmp_path / "plain").write_text(text)
    (tmp_path / "packed").write_bytes(gzip.compress(text.encode()))
    for name in ("plain", "packed"):
        relations = read_relations(tmp_path / name)
        assert relations.times.tolist() == [[1, 2]] and relations.poses.tolist() == [[0.5, -0.25, 0.125]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"1 2 3\n", "line 1: a relation is 8 numbers"),
        (b"1 2 0 0 0 0 0 0\n1 2 0 0 0 0 0 nan\n", "line 2: a relation is 8 numbers"),
        (b"1 2 0 0 0 0 0 x\n", "line 1: a relation is 8 numbers"),
        (b"# nothing\n", "holds no relation"),
        (gzip.compress(b"1 2 3\n" * 100, mtime=0)[:20], "is no text of relations"),
        (b"\xff\xfe", "is no text of relations"),
    ],
)
def test_what_is_no_file_of_relations(tmp_path: Path, content: bytes, message: str):
    (tmp_path / "file").write_bytes(content)
    with pytest.raises(SourceError, match=message):
        read_relations(tmp_path / "file")


def test_published_figures_go_by_the_name_of_the_log():
    assert published("aces-raw")["Cartographer (2016)"] == (0.0375, 0.0426)
    assert published("my-robot") == {}

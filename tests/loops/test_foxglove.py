"""What `loops --mcap` writes, read back by the format's own library."""

import base64
import json
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from calling import Call

from m2t_text.errors import M2TError
from m2t_text.loops.foxglove import SCHEMAS, TOPICS, write_mcap
from m2t_text.loops.graph import pose_graph

if TYPE_CHECKING:
    from m2t_text.loops.detection import LoopDetection

reader = pytest.importorskip("mcap.reader")


def test_everything_is_in_the_file(detection: "LoopDetection", tmp_path: Path) -> None:
    path, graph = tmp_path / "a.mcap", pose_graph(detection)
    write_mcap(detection, graph, path)
    with path.open("rb") as file:
        told = [
            (schema, channel.topic, message.log_time, json.loads(message.data))
            for schema, channel, message in reader.make_reader(file).iter_messages()
        ]
    counts = Counter(topic for _, topic, _, _ in told)
    assert counts["/tf"] == len(detection.log.scans) and counts["/map"] == counts["/trajectory"] == 1
    assert counts["/loops"] == len(detection.loops) > 0
    assert counts["/refused"] == len(detection.refused) and counts["/waiting"] == len(detection.waiting)
    for schema, topic, _, body in told:
        assert schema.name == TOPICS[topic] and set(body) == set(SCHEMAS[schema.name])
    times = [time for _, _, time, _ in told]
    assert times == sorted(times)
    bodies = {topic: body for _, topic, _, body in told}
    points = np.frombuffer(base64.b64decode(bodies["/map"]["data"]), "<f4").reshape(-1, 3)
    assert len(points) > 100 and np.isfinite(points).all()
    last = bodies["/trajectory"]["poses"][-1]
    assert np.allclose([last["position"]["x"], last["position"]["y"]], detection.survey.trajectory[-1, :2])
    line = bodies["/loops"]["entities"][0]["lines"][0]["points"]
    ends = {(round(end["x"], 6), round(end["y"], 6)) for end in line}
    known = max(detection.loops, key=lambda loop: loop.known)
    expected = detection.survey.trajectory[[known.place, known.scan], :2]
    assert ends == {(round(x, 6), round(y, 6)) for x, y in expected.tolist()}


def test_a_file_that_cannot_be_written(detection: "LoopDetection", tmp_path: Path) -> None:
    with pytest.raises(M2TError, match="cannot write"):
        write_mcap(detection, pose_graph(detection), tmp_path / "no" / "a.mcap")


def test_it_is_told_before_the_work(call: Call, circuit: Path, tmp_path: Path) -> None:
    status, out, err = call("loops", circuit, "--mcap", tmp_path / "no" / "a.mcap")
    assert status == 2 and not out and "no" in err

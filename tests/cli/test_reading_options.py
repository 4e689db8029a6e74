"""The options that say how logs are read stand on every command that reads some, and mean the same there."""

from pathlib import Path

import pytest
from bags import Messages, Sent
from calling import Call

from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen

READERS = ("index", "search", "inspect", "loops", "evaluate", "evaluate-map", "evaluate-loops")
OPTIONS = ("--scan-topic", "--odometry-topic", "--name", "--laser-pose", "--upside-down", "--height")


@pytest.mark.parametrize("command", READERS)
def test_every_command_that_reads_logs_takes_them(call: Call, command: str) -> None:
    status, told, _ = call(command, "--help")
    assert status == 0 and [option for option in OPTIONS if option not in told] == []


def test_they_reach_the_reader(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    write_carmen(simulate(Simulation(travel=3.0, beams=30)), path)
    for command in ("index", "loops", "evaluate", "evaluate-map"):
        status, out, error = call(command, path, "--laser-pose", "99", "0", "180")
        assert (status, out) == (2, "") and "--laser-pose takes metres" in error
        status, out, error = call(command, path, "--height", "2", "1")
        assert (status, out) == (2, "") and "--height takes two heights" in error


def test_loops_takes_one_of_several_scan_topics(call: Call, tmp_path: Path) -> None:
    ros, drive = Messages(1), simulate(Simulation(travel=9.0, beams=60))
    sent = [*ros.log(drive)]
    sent += [Sent(one.time, "/scan_filtered", one.message) for one in sent if one.topic == "/scan"]
    bag = ros.write(tmp_path / "filtered.bag", sent)
    status, _, error = call("loops", bag)
    assert status == 2 and "/scan, /scan_filtered; name one by --scan-topic" in error
    status, out, _ = call("loops", bag, "--scan-topic", "/scan_filtered", "--odometry-topic", "/odom")
    assert status == 0 and f"{len(drive.scans)} scans, 9" in out

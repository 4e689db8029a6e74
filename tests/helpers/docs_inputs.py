"""What the commands in the docs read beside public logs: ``python -m docs_inputs NAME...`` writes them here."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from bags import Messages, Sent

from m2t_text.index.map_index import MapIndex
from m2t_text.logs import Log, read_log
from m2t_text.logs.simulation.simulator import Simulation, simulate
from m2t_text.plotting.canvas import metres
from m2t_text.util.geometry import transform

LOG = "freiburg-101-corrected.log.gz"
HEIGHTS = np.arange(0.0, 2.0, 0.25)  # m, of the points of a wall


def short_drive() -> Log:
    log = simulate(Simulation(travel=3.0, beams=20))
    return replace(log, scans=log.scans[:12])


def bag() -> None:
    """A bag of a public log, under the name of its building."""
    ros = Messages(2)
    ros.write(Path("freiburg-101.mcap"), ros.log(read_log(Path(LOG))))
    Path("freiburg-101.mcap").rename("freiburg-101")


def two() -> None:
    """A robot with two lasers."""
    ros = Messages(2)
    sent = list(ros.log(short_drive()))
    rear = [Sent(one.time, "/rear/scan", one.message) for one in sent if one.topic == "/scan"]
    ros.write(Path("two.mcap"), [*sent, *rear])


def bare() -> None:
    """A bag without transforms."""
    ros = Messages(1)
    ros.write(Path("bare.bag"), [one for one in ros.log(short_drive()) if one.topic != "/tf_static"])


def clouds() -> None:
    """The walls of a map of the index, as a cloud of points; and its keypoints in millimetres."""
    index = MapIndex.open("indexes/default")
    document = index.document("freiburg-101/000120")
    flat = transform(document.viewpoint, metres(document.text, index.parameters.mapping.cell))
    points = np.concatenate([np.column_stack([flat, np.full(len(flat), height)]) for height in HEIGHTS])
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA ascii\n"
    )
    rows = "".join(f"{x:.3f} {y:.3f} {z:.3f}\n" for x, y, z in points)
    Path("corner.pcd").write_text(header + rows)
    np.save("millimetres.npy", flat * 1000)


def damage() -> None:
    """Turns one bit in the middle of the largest file of an index."""
    file = max(Path("indexes/office").iterdir(), key=lambda path: path.stat().st_size)
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


if __name__ == "__main__":
    makers = {maker.__name__: maker for maker in (bag, two, bare, clouds, damage)}
    for name in sys.argv[1:]:
        makers[name]()

"""Which topics of a bag are read: the lasers', and the odometry and transforms of the same robot."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from m2t_text.errors import PartError
from m2t_text.logs.log import LogOptions
from m2t_text.logs.ros.messages import ECHOES, LASER, ODOMETRY, POINTS, TRANSFORMS

SCANS = (LASER, ECHOES, POINTS)  # the better first
NONE = "none"  # given for a topic of odometry
LISTED = 12  # topics or frames named in one line


@dataclass(frozen=True)
class Chosen:
    """Topics to read. ``odometry`` is None to go by tf, or by nothing if not ``by_tf`` either."""

    scans: tuple[str, ...]
    odometry: str | None
    by_tf: bool
    transforms: frozenset[str]


def choose(topics: dict[str, str], options: LogOptions) -> Chosen:
    """The topics to read of those of a bag, given with their types.

    Where several would do, the one of the robot whose scans or odometry are named is taken: the one whose name
    begins as theirs. Raises PartError naming the option that says which.
    """
    robots = {_robot(topic) for topic, kind in topics.items() if kind == TRANSFORMS}
    scans = _scans(topics, options, robots)
    named = None if options.odometry in (None, NONE) else _named(
        topics, (ODOMETRY, TRANSFORMS), str(options.odometry), "--odometry-topic"
    )  # fmt: skip
    robot = _robot_of(named or scans[0], robots)
    if options.odometry == NONE:
        odometry = None
    elif named is not None:
        odometry = None if topics[named] == TRANSFORMS else named
    else:
        held = sorted(topic for topic, kind in topics.items() if kind == ODOMETRY)
        odometry = _one(_of(held, robot, robots), ODOMETRY, "--odometry-topic")
    by_tf = odometry is None and options.odometry != NONE
    return Chosen(scans, odometry, by_tf, _transforms(topics, robot, robots))


def _scans(topics: dict[str, str], options: LogOptions, robots: set[str]) -> tuple[str, ...]:
    if options.scan:
        return tuple(dict.fromkeys(_named(topics, SCANS, one, "--scan-topic") for one in options.scan))
    for kind in SCANS:
        held = sorted(topic for topic, one in topics.items() if one == kind)
        if held and options.odometry not in (None, NONE):
            held = _of(held, _robot_of(f"/{str(options.odometry).strip('/')}", robots), robots)
        found = _one(held, kind, "--scan-topic", "; twice reads two lasers of one robot as one")
        if found:
            return (found,)
    known = listed(f"{topic} ({plain(kind)})" for topic, kind in sorted(topics.items()))
    raise PartError(f"no laser scans ({plain(LASER)}) in the bag; its topics are {known}")


def _named(topics: dict[str, str], kinds: Sequence[str], wanted: str, option: str) -> str:
    """The topic of one of the kinds that a user names, with or without its slash."""
    fitting = [topic for topic, kind in sorted(topics.items()) if kind in kinds]
    for topic in fitting:
        if topic.strip("/") == wanted.strip("/"):
            return topic
    raise PartError(f"{option}: no topic {wanted!r} of the type {plain(kinds[0])}; there is {listed(fitting)}")


def _one(held: Sequence[str], kind: str, option: str, more: str = "") -> str | None:
    """The only topic; None if there is none. Raises PartError if there are several."""
    if len(held) > 1:
        raise PartError(f"several topics of the type {plain(kind)}: {listed(held)}; name one by {option}{more}")
    return held[0] if held else None


def _robot(topic: str) -> str:
    """The namespace of a topic: "/r1/tf" is of "/r1"."""
    return topic.rpartition("/")[0]


def _robot_of(topic: str, robots: Iterable[str]) -> str | None:
    """The robot whose transforms belong to a topic: of the longest name with which the topic's begins."""
    fitting = [robot for robot in robots if topic == robot or topic.startswith(f"{robot}/")]
    return max(fitting, key=len, default=None)


def _of(held: list[str], robot: str | None, robots: set[str]) -> list[str]:
    """Of some topics those of a robot, if there are several robots."""
    ours = [topic for topic in held if _robot_of(topic, robots) == robot]
    return ours if robot is not None and len(robots) > 1 else held


def _transforms(topics: dict[str, str], robot: str | None, robots: set[str]) -> frozenset[str]:
    """The topics of a robot's transforms: its own, and those of all robots for what it has none of."""
    held = [topic for topic, kind in topics.items() if kind == TRANSFORMS]
    if robot is None and len(robots) > 1:
        raise PartError(
            f"transforms of several robots: {listed(sorted(held))}; name one by --odometry-topic, as "
            f"--odometry-topic {min(held)}"
        )
    if len(robots) <= 1:
        return frozenset(held)
    ours = {topic for topic in held if _robot(topic) == robot}
    lacking = {"tf", "tf_static"} - {topic.rpartition("/")[2] for topic in ours}
    above = {f"{name}/{lack}" for lack in lacking for name in robots if f"{robot}/".startswith(f"{name}/")}
    return frozenset(ours | (above & set(held)))


def plain(kind: str) -> str:
    """A type's name as users of both ROS know it."""
    return kind.replace("/msg/", "/")


def listed(names: Iterable[str]) -> str:
    """Names for one line."""
    every = list(names)
    more = f" and {len(every) - LISTED} more" if len(every) > LISTED else ""
    return ", ".join(every[:LISTED]) + more if every else "none"

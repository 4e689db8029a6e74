"""Where a robot is in a saved map, and how sure that is."""

from dataclasses import asdict, dataclass
from typing import Any, Literal

from m2t_text.recognition.verdict import Reason, Verdict
from m2t_text.util.types import Floats

State = Literal["unknown", "tracked", "lost"]


@dataclass(frozen=True)
class Place:
    """The answer to one request.

    Attributes:
        verdict: whether to believe it. With ``none`` the pose is no answer.
        probability: that the pose is right; None where nothing was verified.
        reason: for the verdict.
        state: ``tracked`` from a `match` on; ``lost`` once the robot sees other walls than it should, or when
            what is found contradicts where that match and the drive since then lead: it was carried away.
        seconds: that the answer took.
        dataset: in which the robot is; None where nothing was found.
        map_id: of the map that shows the place.
        pose: (3,) of the robot now, in the frame of the dataset's trajectory or map; None as the dataset.
        covariance: (3, 3) of x, y and theta, in that frame's axes, metres and radians; None as the pose.
        confirmed: whether other answers of the same drive made it a `match`, which it was not by itself.
        first: whether it is the first `match` of the drive, or since the robot was lost.
    """

    verdict: Verdict
    probability: float | None
    reason: Reason
    state: State
    seconds: float
    dataset: str | None = None
    map_id: str | None = None
    pose: Floats | None = None
    covariance: Floats | None = None
    confirmed: bool = False
    first: bool = False

    def to_json(self) -> dict[str, Any]:
        """The same as numbers, strings and lists."""
        return {
            "dataset": self.dataset,
            "map_id": self.map_id,
            "pose": None if self.pose is None else self.pose.tolist(),
            "covariance": None if self.covariance is None else self.covariance.tolist(),
            "probability": self.probability,
            "verdict": self.verdict,
            "reason": asdict(self.reason),
            "state": self.state,
            "confirmed": self.confirmed,
            "first": self.first,
            "seconds": self.seconds,
        }

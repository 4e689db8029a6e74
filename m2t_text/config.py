"""Every parameter once, typed, with its unit and its place in the paper. A profile chooses them all."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from m2t_text.errors import M2TError
from m2t_text.util.names import NAME_LENGTH

RINGS, RADIUS, QUARTERS = 10, 1000.0, 4  # of what parameters may be
LIMITS = {
    "run_length": (0.1, 1000.0),
    "range_limit": (0.1, 1000.0),
    "cell": (0.01, 10.0),
    "window": (0, 200),
    "directions": (1, 10),
}


@dataclass(frozen=True)
class MappingParameters:
    """From a log to local maps (paper, IV-A)."""

    run_length: float = 5.0  # m of travel in a local map (IV-A: 3 m)
    range_limit: float = 8.0  # m; farther returns blur the centre of gravity
    cell: float = 0.1  # m; side of an occupancy cell, and the quantisation of the pose words (IV-C, V-B)


@dataclass(frozen=True)
class DescriptionParameters:
    """From a local map to its text (paper, III-A, III-B, IV-B, IV-C)."""

    viewpoint: Literal["trajectory", "centre"] = (
        "centre"  # of gravity, or the robot's pose nearest to it (IV-B)
    )
    radii: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0)  # m; outer radii of the rings (III-A: 10)
    free_space: bool = True  # whether a text says what was seen to be free, too; the paper's does not


@dataclass(frozen=True)
class MatchingParameters:
    """From a query's text to scores (paper, III-C, IV-D)."""

    score: Literal["intersection", "agreement"] = "agreement"  # the paper's, or at one agreed offset
    window: int = 10  # cells; D_xy = 1 m (eqs. 2, 3)
    turns: tuple[int, ...] = (0, 1, 2, 3)  # quarter turns of the query that are tried; the best is kept
    directions: int = 3  # likely directions of the query's walls that are tried, each with all turns
    weighted: bool = True  # bag of words: by rarity, and divided by the geometric mean of both maps' weights

    @property
    def tolerance(self) -> int:
        """Cells by which keypoints differ that match once the query is laid over a map."""
        return self.window if self.score == "intersection" else 1


@dataclass(frozen=True)
class Parameters:
    """All parameters of one profile."""

    profile: str = "default"
    mapping: MappingParameters = field(default_factory=MappingParameters)
    description: DescriptionParameters = field(default_factory=DescriptionParameters)
    matching: MatchingParameters = field(default_factory=MatchingParameters)


PROFILES = {
    "default": Parameters(),
    "paper": Parameters(
        profile="paper",
        mapping=MappingParameters(run_length=3.0),
        description=DescriptionParameters(
            viewpoint="trajectory", radii=tuple(0.4 * k for k in range(1, 11)), free_space=False
        ),
        matching=MatchingParameters(score="intersection", directions=1, weighted=False),
    ),
}


def parameters_of(profile: str) -> Parameters:
    """The parameters of a profile by its name. Raises M2TError if there is none."""
    if profile not in PROFILES:
        raise M2TError(f"no profile {profile!r}; there are {', '.join(PROFILES)}")
    return PROFILES[profile]


def from_dict(fields: dict[str, Any]) -> Parameters:
    """The parameters that `dataclasses.asdict` took apart, also after a way through JSON.

    Raises:
        ValueError, TypeError, KeyError: if it is not what this version writes.
    """
    description, matching = fields["description"], fields["matching"]
    return Parameters(
        fields["profile"],
        MappingParameters(**fields["mapping"]),
        DescriptionParameters(**(description | {"radii": tuple(description["radii"])})),
        MatchingParameters(**(matching | {"turns": tuple(matching["turns"])})),
    )


def check_parameters(parameters: Parameters) -> Parameters:
    """The parameters themselves, if what they ask for is bounded in time and memory.

    Raises:
        ValueError, TypeError: if not.
    """
    sections = (parameters.mapping, parameters.description, parameters.matching)
    values = {name: value for section in sections for name, value in asdict(section).items()}
    for name, (least, most) in LIMITS.items():
        if not least <= values[name] <= most or type(values[name]) not in (int, type(least)):
            raise ValueError(f"{name} is not within {least}…{most}")
    radii, turns = values["radii"], values["turns"]
    if len(radii) > RINGS or not all(0 < radius <= RADIUS for radius in radii):
        raise ValueError(f"there are up to {RINGS} radii, of up to {RADIUS} m")
    if len(turns) > QUARTERS or not all(turn in range(QUARTERS) for turn in turns):
        raise ValueError("turns are quarters of a whole one")
    if not parameters.profile.isprintable() or len(parameters.profile) > NAME_LENGTH:
        raise ValueError(f"a profile has a name of up to {NAME_LENGTH} printable characters")
    return parameters

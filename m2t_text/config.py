"""Every parameter once, typed, with its unit and its place in the paper. A profile chooses them all."""

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class MappingParameters:
    """From a log to local maps (paper, IV-A)."""

    run_length: float = 3.0  # m of travel in a local map (IV-A)
    range_limit: float = 8.0  # m; farther returns blur the centre of gravity
    cell: float = 0.1  # m; side of an occupancy cell, and the quantisation of the pose words (IV-C, V-B)


@dataclass(frozen=True)
class DescriptionParameters:
    """From a local map to its text (paper, III-A, III-B, IV-B, IV-C)."""

    viewpoint: Literal["trajectory", "centre"] = (
        "centre"  # nearest trajectory pose (IV-B), or the centre itself
    )
    radii: tuple[float, ...] = tuple(0.15 * k for k in range(1, 11))  # m; outer radii of the D = 10 rings


@dataclass(frozen=True)
class MatchingParameters:
    """From a query's text to scores (paper, III-C, IV-D)."""

    window: int = 10  # cells; D_xy = 1 m (eqs. 2, 3)
    turns: tuple[int, ...] = (0, 1, 2, 3)  # quarter turns of the query that are tried; the best is kept
    weighted: bool = True  # words weighted by their rarity, scores normalised by both maps' weights


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
        description=DescriptionParameters(viewpoint="trajectory", radii=tuple(0.4 * k for k in range(1, 11))),
        matching=MatchingParameters(weighted=False),
    ),
}

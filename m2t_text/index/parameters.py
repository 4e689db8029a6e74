"""The parameters of an index: as JSON, and whether a search with them is bounded."""

import json
from dataclasses import asdict

from m2t_text.config import DescriptionParameters, MappingParameters, MatchingParameters, Parameters
from m2t_text.names import NAME_LENGTH

RINGS, RADIUS, QUARTERS = 10, 1000.0, 4  # of what parameters may be
LIMITS = {
    "run_length": (0.1, 1000.0),
    "range_limit": (0.1, 1000.0),
    "cell": (0.01, 10.0),
    "window": (0, 200),
    "directions": (1, 10),
}


def to_json(parameters: Parameters) -> str:
    """All parameters as JSON, in a fixed order."""
    return json.dumps(asdict(parameters), sort_keys=True)


def from_json(string: str) -> Parameters:
    """The parameters that `to_json` wrote.

    Raises:
        ValueError, TypeError, KeyError: if it is not what this version writes.
    """
    fields = json.loads(string)
    description, matching = fields["description"], fields["matching"]
    description["radii"] = tuple(description["radii"])
    matching["turns"] = tuple(matching["turns"])
    return Parameters(
        fields["profile"],
        MappingParameters(**fields["mapping"]),
        DescriptionParameters(**description),
        MatchingParameters(**matching),
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

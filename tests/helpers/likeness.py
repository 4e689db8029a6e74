"""How alike two texts of one place are."""

import numpy as np

from m2t_text.description.text import Text


def alike(one: Text, other: Text) -> float:
    """Share of the tokens that have the same word in the other text, not more than one cell away."""
    shares = []
    for turn in range(4):  # the walls alone do not say which of the four directions is chosen
        turned = one.turned(turn)
        near = (
            (np.abs(turned.wx[:, None] - other.wx) <= 1)
            & (np.abs(turned.wy[:, None] - other.wy) <= 1)
            & (turned.wa[:, None] == other.wa)
        )
        shares.append(float(near.any(axis=1).mean()))
    return max(shares)

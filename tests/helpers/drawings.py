"""Small maps, drawn with letters: # occupied, . free, blank unknown. The first line is the top of the map."""

import numpy as np

from m2t_text.saved_maps.grid import FREE, OCCUPIED, UNKNOWN, Grid, States

STATES = {"#": OCCUPIED, ".": FREE, " ": UNKNOWN}


def drawn(*lines: str) -> States:
    """(rows, columns), row 0 the last line, as in a `Grid`."""
    return np.array([[STATES[letter] for letter in line] for line in lines[::-1]], dtype=np.int8)


def room(
    width: float, height: float, resolution: float = 0.05, origin: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> Grid:
    """An empty room of this size inside, in metres, with walls of one cell; its inner corner is a cell from the
    grid's."""
    columns, rows = round(width / resolution), round(height / resolution)
    states = np.full((rows + 2, columns + 2), OCCUPIED, dtype=np.int8)
    states[1:-1, 1:-1] = FREE
    return Grid(states, resolution, np.array(origin))

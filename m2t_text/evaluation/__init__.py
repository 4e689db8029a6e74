"""How well places are found: the paper's evaluation on logs whose ground truth is known (paper, V)."""

"""``python -m m2t_text`` is the command line."""

from m2t_text.cli import main

main()

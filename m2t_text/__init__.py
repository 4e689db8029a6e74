"""Find a place again: 2D laser maps as text documents in a Whoosh full-text index.

What the command line does, in Python. Lengths are metres, angles radians, poses arrays ``[x, y, theta]``.

Examples:
    Index a log, and look up the map that begins at its scan 40:

    >>> import m2t_text as m2t
    >>> index = m2t.open_index("indexes/mine")
    >>> index.add(m2t.open_source("drive.log"))
    >>> query = m2t.Query.of(m2t.describe_at(m2t.read_log("drive.log"), 40, index.parameters))
    >>> finding = m2t.find(index, query, top=3)
    >>> finding.verdict, finding.results[0].hit.document.dataset
    ('match', 'drive')

The names that the package offers stand in its stub, ``__init__.pyi``. Each is loaded when it is first used, so
that importing the package is quick and writes nothing.
"""

import lazy_loader

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

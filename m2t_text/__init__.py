"""Find a place again: 2D laser maps as text documents in a Whoosh full-text index."""

__version__ = "0.1.0"

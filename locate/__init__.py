"""Floor 3: runs, plumes, maps, files, people."""

__version__ = "0.1.0"

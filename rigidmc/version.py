"""The version, in one place: pyproject.toml, results and run directories take it from here."""

VERSION = "0.1.0"

"""Readers and writers of pose-graph files."""

from slamcli.formats.diagnostics import Diagnostic, ParseError
from slamcli.formats.reader import read
from slamcli.formats.recognize import DIALECTS
from slamcli.formats.writer import render, write

__all__ = ["DIALECTS", "Diagnostic", "ParseError", "read", "render", "write"]

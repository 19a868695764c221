"""Replaces generated tables in the documentation."""
from __future__ import annotations

from pathlib import Path

from python_env import ROOT

#: Folder of the result pages, one per table.
RESULTS = ROOT / "docs/src/results"


def write_between(document: Path, mark: str, text: str) -> None:
    """Replaces the text between the comments `mark:begin` and `mark:end` of a document.

    Raises ValueError if the document lacks one of them, OSError if it cannot be read or written.
    """
    begin, end = f"<!-- {mark}:begin -->", f"<!-- {mark}:end -->"
    before, _, rest = document.read_text().partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise ValueError(f"{document} has no {begin} ... {end}")
    document.write_text(f"{before}{begin}\n{text}\n{end}{after}")

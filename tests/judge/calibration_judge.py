"""Shared by the parts of `make calibration`: running the program, rows and comparisons, skips."""
from __future__ import annotations

import argparse
import json
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

from rigs import blind_view


class Failed(Exception):
    """A run failed; the message names it and its log."""


class Skipped(Exception):
    """Data or packages are missing; the message names them."""


@dataclass
class Row:
    """One figure and its limit."""

    what: str
    figure: str
    reached: float
    allowed: float
    unit: str
    by: str

    @property
    def passed(self) -> bool:
        return self.reached <= self.allowed


@dataclass
class Comparison:
    """A table that compares Penumbra with other programs, and remarks on the measurement."""

    mark: str
    title: str
    header: list[str]
    lines: list[list[str]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def text(self) -> str:
        rows = [self.header, ["---"] * len(self.header), *self.lines]
        table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
        return "\n\n".join([table, *self.remarks])


class Judge:
    """Runs the program, each time in a separate folder, and collects skipped parts."""

    def __init__(self, a: argparse.Namespace) -> None:
        self.a, self.penumbra = a, str(a.penumbra)
        self.skipped: list[str] = []

    def skip(self, what: str, why: object) -> None:
        """Prints that a part is skipped, and counts it."""
        self.skipped.append(what)
        print(f"SKIPPED {what}: {why}", flush=True)

    def folder(self, name: str) -> Path:
        folder = self.a.out / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return folder

    def run(self, work: Path, *arguments: object, refused: bool = False) -> str:
        """Runs the program and returns its output; with `refused` it must fail."""
        command = [self.penumbra, *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, cwd=work)
        output = done.stdout + done.stderr
        with (work / "log.txt").open("a") as log:
            log.write(f"\n$ {' '.join(command)}\n{output}")
        if (done.returncode != 0) != refused:
            last = next((line for line in reversed(output.splitlines()) if line.strip()), "")
            raise Failed(f"{' '.join(map(str, arguments[:2]))} ended with {done.returncode}: {last} (see {work / 'log.txt'})")
        return output

    def calibrate(self, work: Path, step: str, out: str, *arguments: object) -> dict:
        """Runs a calibration step and returns the contents of the file that it wrote."""
        path = work / out
        self.run(work, "calibrate", step, "--out", path, "--force", *arguments)
        return json.loads(path.read_text())

    def imported(self, work: Path, session: Path) -> Path:
        """Imports a session's folder without its ground truth; returns the recording."""
        view = blind_view(session, work / "rig")
        mcap = work / "session.mcap"
        self.run(work, "import", view, mcap, "--force")
        return mcap

    def data(self, path: str) -> Path:
        return present(self.a.data / path)

    def simulated(self, pattern: str) -> list[Path]:
        """Returns the folders of path-traced rigs made by tests/judge/rigsim_calibration.py."""
        found = sorted(self.a.simulated.glob(f"{pattern}*/truth_rig.json")) if self.a.simulated else []
        if not found:
            raise Skipped(f"no rigs {pattern}* (--simulated DIR, made by tests/judge/rigsim_calibration.py)")
        return [path.parent for path in found]


def truth_of(session: Path) -> dict:
    return json.loads((session / "truth_rig.json").read_text())


def present(path: Path) -> Path:
    """Returns the path if it exists; else raises Skipped."""
    if not path.exists():
        raise Skipped(f"{path} is missing")
    return path


def pictures_in(folder: Path, pattern: str) -> list[Path]:
    """Returns the pictures of a folder by name; raises Skipped if there are none."""
    found = sorted(folder.glob(pattern))
    if not found:
        raise Skipped(f"{folder / pattern} matches no file")
    return found


def copied(work: Path, files: list[Path], copies: int | None = None) -> Path:
    """Copies the files to a new folder `pictures`; with `copies`, makes that many of each, named STEM~0, STEM~1 and so on."""
    folder = work / "pictures"
    folder.mkdir()
    for file in files:
        names = [file.name] if copies is None else [f"{file.stem}~{k}{file.suffix}" for k in range(copies)]
        for name in names:
            shutil.copyfile(file, folder / name)
    return folder

"""Rigs with known truth: the bundled sessions, and folders of rigs outside the repository."""
from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from python_env import ROOT

SESSIONS = ROOT / "tests/fixtures/sessions"
#: Rigs that a full run judges beside the bundled sessions.
OUTSIDE = ("courtyard", "desk", "desk-lamp", "desk-marker", "desk-sphere")
#: What a rig's folder holds for the judge alone.
JUDGES_ONLY = {"truth", "truth_right", "masks", "masks_right", "light_truth", "truth_rig.json", "camera_truth.csv"}


@dataclass(frozen=True)
class Rig:
    """One recording and its truth."""

    name: str
    #: A session file (.mcap) without the truth, or the folder of a rig, which holds the truth too.
    recording: Path
    #: Folder with the judge's files.
    truth: Path
    #: Judge every N-th frame that has a truth.
    every: int


def bundled() -> list[Rig]:
    """The repository's own sessions. They have few true frames, and all of them are judged."""
    return [Rig(f"{truth.name}.mcap", SESSIONS / f"{truth.name}.mcap", truth, 1) for truth in sorted((SESSIONS / "truth").iterdir())]


def outside(folder: Path, every: int) -> list[Rig]:
    """The rigs with a truth in a folder of rigs."""
    found = sorted(file.parent for file in folder.glob("*/rig.json") if (file.parent / "truth").is_dir())
    return [Rig(rig.name, rig, rig, every) for rig in found]


def blind_view(rig: Path, target: Path) -> Path:
    """A copy of all that the rig recorded, without the judge's files: the program cannot read the truth."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(rig, target, ignore=lambda _, names: JUDGES_ONLY & set(names), copy_function=shutil.copyfile)
    target.chmod(0o755)
    for path in target.rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)
    return target

"""Rigs with ground truth: the bundled sessions, and folders of rigs outside the repository."""
from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from python_env import ROOT

SESSIONS = ROOT / "tests/fixtures/sessions"
#: Rigs that a full run evaluates in addition to the bundled sessions.
OUTSIDE = ("courtyard", "desk", "desk-depth", "desk-lamp", "desk-marker", "desk-near", "desk-sphere", "desk-stereo", "desk-still")
#: Where they are, if they are there.
FOLDERS = [ROOT / "../shared/truth", ROOT / "../shared/rigs"]
#: Ground truth in a rig's folder, which the program must not read.
JUDGES_ONLY = {"truth", "truth_right", "masks", "masks_right", "light_truth", "truth_rig.json", "camera_truth.csv"}


@dataclass(frozen=True)
class Rig:
    """One recording and its ground truth."""

    name: str
    #: A session file (.mcap) without ground truth, or the folder of a rig, which includes it.
    recording: Path
    #: Folder of the ground truth.
    truth: Path
    #: Evaluate every N-th frame with ground truth.
    every: int


def bundled() -> list[Rig]:
    """Returns the bundled sessions. They have ground truth for few frames, and all of them are evaluated."""
    return [Rig(f"{truth.name}.mcap", SESSIONS / f"{truth.name}.mcap", truth, 1) for truth in sorted((SESSIONS / "truth").iterdir())]


def outside(folder: Path, every: int) -> list[Rig]:
    """Returns the rigs with ground truth in a folder of rigs."""
    found = sorted(file.parent for file in folder.glob("*/rig.json") if (file.parent / "truth").is_dir())
    return [Rig(rig.name, rig, rig, every) for rig in found]


def blind_view(rig: Path, target: Path) -> Path:
    """Copies a rig's recordings without the ground truth, so that the program cannot read it."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(rig, target, ignore=lambda _, names: JUDGES_ONLY & set(names), copy_function=shutil.copyfile)
    target.chmod(0o755)
    for path in target.rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)
    return target

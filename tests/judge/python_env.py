"""Finds a Python with the packages of a script: the running one, or a venv under target/."""
from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))


class Unavailable(Exception):
    """No such Python is available; the message gives the reason and a remedy."""


def has(python: str | Path, modules: list[str]) -> bool:
    """Whether that Python can import all modules."""
    return Path(python).exists() and not subprocess.run([str(python), "-c", f"import {', '.join(modules)}"], capture_output=True).returncode


def python_with(modules: list[str], requirements: Path, given: str | None = None) -> str:
    """Returns the path of a Python with `modules`; installs `requirements` into target/venv if needed."""
    own = TARGET / "venv/bin/python"
    for python in [given] if given else [sys.executable, own]:
        if has(python, modules):
            return str(python)
    if given:
        raise Unavailable(f"{given} lacks a package of {requirements.name}")
    if not own.exists():
        try:
            venv.create(own.parent.parent, with_pip=True, clear=True)
        except (subprocess.CalledProcessError, OSError) as error:
            raise Unavailable(f"cannot make a Python environment ({error}); apt-get install python3-venv") from error
    print(f"installing {requirements.name} into {own.parent.parent}", file=sys.stderr)
    if subprocess.run([str(own), "-m", "pip", "install", "--quiet", "-r", str(requirements)]).returncode:
        raise Unavailable(f"pip could not install {requirements.name}; is there a network?")
    return str(own)


def run_with(modules: list[str], requirements: Path) -> None:
    """Restarts this script under a Python with `modules`, unless this one has them."""
    python = python_with(modules, requirements)
    if python != sys.executable:
        os.execv(python, [python, *sys.argv])


def install_optional(requirements: Path) -> None:
    """Tries to install each requirement separately, wheels only, into the environment under target/.

    Leaves every other Python as it is. What could not be had is for the caller to notice.
    """
    if Path(sys.prefix) != TARGET.resolve() / "venv":
        return
    for line in (line.partition("#")[0].strip() for line in requirements.read_text().splitlines()):
        name, _, version = line.partition("==")
        if name and installed_version(name) != version:
            subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "--only-binary", ":all:", line], capture_output=True)


def installed_version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None

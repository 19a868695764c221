#!/usr/bin/env python3
"""Evaluate calibration, registration and tag detection against known references; print tables of figures.

Penumbra's figures come from the program itself (`penumbra calibrate ...`, `penumbra replay`), run on published
pictures and recordings (--data), on path-traced rigs with ground truth (--truth, and --simulated, made by
tests/judge/rigsim_calibration.py), and on pictures rendered here. The program never gets the ground truth.
Other programs (OpenCV, the AprilTag library, kornia, locus) run on the same pictures.

    tests/judge/calibration.py                               all parts whose data are available
    tests/judge/calibration.py --only tags,intrinsics        some parts
    tests/judge/calibration.py --simulated DIR --write       with simulated rigs; the tables into docs/src/results

Exit status: 0 if every limit is met, 1 if one is exceeded, 2 if a run failed or nothing could be evaluated.
Parts whose data or packages are missing are printed as SKIPPED and counted.
"""
from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from calibration_judge import Comparison, Failed, Judge, Row, Skipped
from python_env import ROOT, TARGET, Unavailable, install_optional, run_with
from tables import RESULTS, write_between

REQUIREMENTS = Path(__file__).with_name("requirements-calibration.txt")
DETECTORS = Path(__file__).with_name("requirements-detectors.txt")
PACKAGES = ["numpy", "cv2"]
PARTS = ("intrinsics", "tracker", "registration", "environment", "tags", "colour")

Task = Callable[[Judge], Iterator[Row | Comparison]]


def tasks() -> dict[str, list[Task]]:
    """Returns the tasks of each part; imported late, after numpy and OpenCV have been found."""
    from calibration_colour import charts, white_balance
    from calibration_detectors import board_plane, detectors, grids
    from calibration_lenses import lenses, simulated_lens
    from calibration_rigs import environment, registration, simulated, tag_map, waved
    found = [[lenses, simulated_lens], [simulated, waved, tag_map], [registration], [environment], [detectors, board_plane, grids], [white_balance, charts]]
    return dict(zip(PARTS, found, strict=True))


def table(rows: list[Row]) -> str:
    lines = ["| data | figure | measured | allowed | | reference |", "|---|---|---|---|---|---|"]
    for r in rows:
        mark = "" if r.passed else " **FAIL**"
        lines.append(f"| {r.what} | {r.figure} | {r.reached:.3f} {r.unit} | {r.allowed:.3f} |{mark} | {r.by} |")
    return "\n".join(lines)


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT / "../shared/data", help="published pictures and calibrations")
    parser.add_argument("--truth", type=Path, default=ROOT / "../shared/truth", help="path-traced rigs")
    parser.add_argument("--simulated", type=Path, help="folder of rigs of tests/judge/rigsim_calibration.py")
    parser.add_argument("--only", help=f"parts to run, comma-separated: {', '.join(PARTS)}")
    parser.add_argument("--penumbra", type=Path, help="the program (default: the release build)")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/src/results")
    parser.add_argument("--out", type=Path, default=TARGET / "calibration", help="files of the runs, table.md, detectors.md, lenses.md")
    a = parser.parse_args()
    a.data, a.truth, a.out = a.data.resolve(), a.truth.resolve(), a.out.resolve()
    a.simulated = a.simulated.resolve() if a.simulated else None
    a.penumbra = (a.penumbra or TARGET / "release/penumbra").resolve()
    return a


class Results:
    """Collected figures and comparisons, and the number of failed runs."""

    def __init__(self, judge: Judge) -> None:
        self.judge, self.failed = judge, 0
        self.rows: list[Row] = []
        self.comparisons: list[Comparison] = []

    def carry_out(self, task: Task) -> None:
        import cv2
        name = task.__name__
        try:
            for result in task(self.judge):
                self.take(result)
        except Skipped as reason:
            self.judge.skip(name, reason)
        except (Failed, OSError, KeyError, ValueError, cv2.error) as error:
            self.failed += 1
            print(f"FAILED {name}: {error}", file=sys.stderr)

    def take(self, result: Row | Comparison) -> None:
        if isinstance(result, Comparison):
            self.comparisons.append(result)
            return
        self.rows.append(result)
        print(f"{result.what}: {result.figure} {result.reached:.3f} {result.unit} (allowed {result.allowed:.3f})", file=sys.stderr)

    def texts(self) -> dict[str, tuple[str, str]]:
        """Returns (title, Markdown) of every table by its mark in the document."""
        figures = {"calibration": ("Figures", table(self.rows))} if self.rows else {}
        return figures | {c.mark: (c.title, c.text()) for c in self.comparisons}


def publish(results: Results, out: Path, write: bool) -> None:
    """Prints every table and writes it to `out`; with `write`, also between its marks in the document."""
    out.mkdir(parents=True, exist_ok=True)
    for mark, (title, text) in results.texts().items():
        file = out / ("table.md" if mark == "calibration" else f"{mark}.md")
        file.write_text(text + "\n")
        print(f"\n## {title}\n\n{text}")
        if write:
            write_between(RESULTS / f"{mark}.md", mark, text)


def main() -> int:
    a = options()
    try:
        run_with(PACKAGES, REQUIREMENTS)
    except Unavailable as error:
        print(error, file=sys.stderr)
        return 2
    wanted = a.only.split(",") if a.only else list(PARTS)
    if unknown := set(wanted) - set(PARTS):
        print(f"--only: no {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}", file=sys.stderr)
        return 2
    if not a.penumbra.exists():
        print(f"{a.penumbra} is missing; run `make build`", file=sys.stderr)
        return 2
    if "tags" in wanted:
        install_optional(DETECTORS)
    judge, parts = Judge(a), tasks()
    results = Results(judge)
    for task in (task for name in wanted for task in parts[name]):
        results.carry_out(task)
    publish(results, a.out, a.write and not results.failed)
    missed = sum(not row.passed for row in results.rows)
    skipped = f" ({', '.join(judge.skipped)})" if judge.skipped else ""
    print(f"\n{len(results.rows)} figures, {missed} exceed their limit, {results.failed} runs failed, {len(judge.skipped)} SKIPPED{skipped}; {a.out / 'table.md'}")
    return 2 if results.failed or not results.rows else 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

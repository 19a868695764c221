#!/usr/bin/env python3
"""Compare the program's pictures with path-traced truth and print a table of figures.

The bundled sessions are judged always, the rigs in --truth if they are there; a missing rig is named
as SKIPPED. For each: `penumbra import` (of a copy without the truth), `penumbra replay --headless
--speed max --frames-out`, then tests/judge/judge.py. Each rig is replayed with both techniques, image-based-shadowing and
shadowing-planes, in both qualities, live and best; the bars hold for both qualities of the first technique. Of rigs in which
nothing moves, the live picture's steadiness is judged, too (tests/judge/steadiness.py). A missed aim is listed and changes nothing.

    tests/judge/fidelity.py                                  all rigs, the table on stdout
    tests/judge/fidelity.py --no-planes                      only the rows of image-based-shadowing
    tests/judge/fidelity.py --sessions desk.mcap,desk --every 4 --jobs 2
    tests/judge/fidelity.py --extra "--lights grid" --extra "desk-marker: --config sphere.toml"
    tests/judge/fidelity.py --write                          the table into docs/src/results/fidelity.md

Exit status: 0 every bar is reached, 1 a bar is missed, 2 something failed.
"""
from __future__ import annotations

import argparse
import json
import math
import shlex
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from python_env import ROOT, TARGET, Unavailable, run_with
from rigs import FOLDERS, OUTSIDE, Rig, blind_view, bundled, outside
from tables import RESULTS, write_between

REQUIREMENTS = Path(__file__).with_name("requirements-judge.txt")
PACKAGES = ["numpy", "PIL"]
# Row -> suffix of its files' names, further arguments of `penumbra replay`.
ROWS = {
    f"{technique}, {quality}": (f"-{technique}-{quality}", ["--technique", technique, "--quality", quality])
    for technique in ("image-based-shadowing", "shadowing-planes")
    for quality in ("live", "best")
}
# Rows that the bars hold for.
BARRED = [row for row in ROWS if row.startswith("image-based-shadowing")]
LIVE = "image-based-shadowing, live"
# What a viewer sees: at the recording's rate, in a loop, in the light that is known by then. It depends on the machine,
# so it has aims and no bars.
SHOWN = "image-based-shadowing, shown"
# How often the recording is shown, and the share of the true frames that must have been seen.
SHOWN_TIMES, SHOWN_LEAST = 4, 0.75
# ... and at least so many pictures: a loop of a third of a second skips the same ones several times.
SHOWN_PICTURES = 120
# A short loop may skip the same frames again and again: it is replayed anew, as often as this.
SHOWN_REPLAYS = 4
#: Limits of the figures of steadiness.
STEADY = {"pump": 0.05, "step": 0.1, "shimmer": 1.05}
# Column of judge.py, heading of the table, digits.
COLUMNS = [
    ("rmse_shadow", "RMSEshd", 2), ("s_err", "s_err", 4), ("s_bias", "s_bias", 4),
    ("s_core", "s_core", 4), ("dE", "dE", 2), ("l_err", "l_err", 4),
    ("dE_lit", "dE_lit", 2), ("dE_object", "dE_obj", 2), ("bad", "bad %", 2),
]


class Failed(Exception):
    """A step failed; the text says which one and where its output is."""


@dataclass
class Result:
    """Figures of one rig."""

    name: str
    #: Row -> column -> value; a technique's rows and those of the baselines.
    rows: dict[str, dict[str, float]]
    #: Error of the white-balance gains in percent, per channel.
    gain_error_percent: list[float] | None
    #: (figure, reached, allowed) over time, of the live picture.
    over_time: list[tuple[str, float, float]] = field(default_factory=list)


def step(command: list[str], log: Path, what: str) -> None:
    """Runs one command and appends its output to `log`; an error quotes its last line."""
    with log.open("a") as sink:
        sink.write(f"\n$ {shlex.join(command)}\n")
        sink.flush()
        code = subprocess.run(command, stdout=sink, stderr=sink).returncode
    if code:
        last = next((line for line in reversed(log.read_text().splitlines()) if line.strip()), "")
        raise Failed(f"{what} ended with {code}: {last} (see {log})")


def recorded(rig: Rig, work: Path, a: argparse.Namespace) -> Path:
    """The session file that the program gets."""
    if rig.recording.is_file():
        return rig.recording
    mcap = work / "session.mcap"
    if not a.compare_only:
        view = blind_view(rig.recording, work / "rig")
        step([str(a.penumbra), "import", str(view), str(mcap), "--force"], work / "log.txt", "import")
    return mcap


def composed(mcap: Path, rig: Rig, row: str, work: Path, a: argparse.Namespace) -> tuple[Path, Path]:
    """Replays a session; gives the folder of its pictures and its report."""
    suffix, arguments = ROWS[row]
    frames, report = work / f"frames{suffix}", work / f"report{suffix}.json"
    if not a.compare_only:
        for old in frames.glob("*.png"):
            old.unlink()
        replay(a, rig, mcap, frames, ["--speed", "max", "--report", str(report), *arguments], row)
    return frames, report


def replay(a: argparse.Namespace, rig: Rig, mcap: Path, frames: Path, arguments: list[str], row: str) -> None:
    """Replays a session into a folder of pictures."""
    step([str(a.penumbra), "replay", str(mcap), "--headless", "--listen", "127.0.0.1:0", "--frames-out", str(frames), "--force",
          *arguments, *extra_arguments(a.extra, rig.name)], frames.parent / "log.txt", f"replay ({row})")


def shown(mcap: Path, rig: Rig, work: Path, live: Path, a: argparse.Namespace) -> dict[str, float]:
    """The figures of what a viewer sees. `live`: the pictures of the live row, as many as the recording has."""
    # Imports numpy, which this script's first Python may lack.
    from judge import Unjudged, judge_pictures

    frames = work / "frames-shown"
    if a.compare_only:
        return judge_pictures(rig.truth, frames, rig.every, SHOWN_LEAST)
    for old in frames.glob("*.png"):
        old.unlink()
    count = max(SHOWN_TIMES * len(list(live.glob("*.png"))), SHOWN_PICTURES)
    for _ in range(SHOWN_REPLAYS):
        replay(a, rig, mcap, frames, ["--quality", "live", "--speed", "1", "--loop", "--as-shown", "--frames", str(count)], SHOWN)
        try:
            return judge_pictures(rig.truth, frames, rig.every, SHOWN_LEAST)
        except Unjudged as error:
            reason = error
    raise reason


def extra_arguments(extra: list[str], rig: str) -> list[str]:
    """What `--extra ARGS` and `--extra "NAME: ARGS"` give for one rig."""
    arguments = []
    for text in extra:
        name, colon, rest = text.partition(":")
        if colon and not name.startswith("-"):
            arguments += shlex.split(rest) if name.strip() == rig else []
        else:
            arguments += shlex.split(text)
    return arguments


def replayed_rows(a: argparse.Namespace) -> list[str]:
    """The rows to replay."""
    wanted = BARRED if a.no_planes else ROWS
    return [row for row in wanted if a.quality in (None, row.rsplit(" ", 1)[1])]


def gain_error(rig: Rig, report: Path) -> list[float] | None:
    """Errors in percent of the white-balance gains found; the truth is the ratio of both cameras' gains."""
    truth = rig.truth / "truth_rig.json"
    if not truth.exists():
        return None
    cameras = json.loads(truth.read_text())
    scene, environment = (cameras[c]["response_truth"]["total_gain_rgb"] for c in ("scene_camera", "environment_camera"))
    found = json.loads(report.read_text())["white_balance"]["gains"]
    return [100 * (f / (s / e) - 1) for f, s, e in zip(found, scene, environment)]


def judged(rig: Rig, a: argparse.Namespace) -> Result:
    """Replays and judges one rig."""
    # Imports numpy, which this script's first Python may lack.
    from judge import judge_baselines, judge_pictures

    work, rows, reports, over_time = a.out / rig.name, {}, [], []
    work.mkdir(parents=True, exist_ok=True)
    (work / "log.txt").write_text("")
    mcap = recorded(rig, work, a)
    for row in replayed_rows(a):
        frames, report = composed(mcap, rig, row, work, a)
        rows[row] = judge_pictures(rig.truth, frames, rig.every)
        reports.append(report)
        if row == LIVE:
            over_time = bars_over_time(rig, frames)
            if a.jobs == 1 and not a.no_shown:
                rows[SHOWN] = shown(mcap, rig, work, frames, a)
    rows |= judge_baselines(rig.truth, rig.every)
    return Result(rig.name, rows, gain_error(rig, reports[0]), over_time)


def bars_over_time(rig: Rig, frames: Path) -> list[tuple[str, float, float]]:
    """The bars for how the live picture changes over time."""
    from steadiness import is_still, largest_changes, steadiness

    if is_still(rig.truth):
        return [(figure, reached, STEADY[figure.split()[0]]) for figure, reached in steadiness(rig.truth, frames).items()]
    if rig.name != "desk":
        return []
    # Its lamp moves.
    ours, wanted = largest_changes(rig.truth, frames)
    return [("change of the object %", ours, 1.5 * wanted)]


def attempt(rig: Rig, a: argparse.Namespace) -> Result | None:
    """Judges one rig; None, and a message, if that fails."""
    # Imports numpy, which this script's first Python may lack.
    from judge import Unjudged

    started = time.monotonic()
    try:
        result = judged(rig, a)
    except (Failed, Unjudged, OSError, KeyError, ValueError) as error:
        print(f"FAILED {rig.name}: {type(error).__name__}: {error}", file=sys.stderr)
        return None
    print(f"{rig.name}: {time.monotonic() - started:.0f} s", file=sys.stderr)
    return result


def bars_of(result: Result, row: str) -> list[tuple[str, float, float]]:
    """The bars that hold for one row."""
    ours, without, quality = result.rows[row], result.rows["without"], row.rsplit(" ", 1)[1]
    found = [
        ("s_err", ours["s_err"], without["s_err"] / 3),
        ("abs s_bias", abs(ours["s_bias"]), 0.015),
        ("dE", ours["dE"], 0.45 * without["dE"]),
    ]
    if "dE_object" in ours:
        found.append(("dE_obj", ours["dE_object"], 5.0))
    if result.name == "desk-lamp":
        found += [("l_err", ours.get("l_err", math.inf), 0.08), ("dE_lit", ours.get("dE_lit", math.inf), 3.0)]
    best = result.rows.get(row.replace(", live", ", best"))
    if quality == "live" and best:
        found += [
            ("s_err of best", ours["s_err"], 1.15 * best["s_err"]),
            ("bad % of best", ours["bad"], 1.2 * best["bad"]),
        ]
        if "dE_object" in ours:
            found.append(("dE_obj of best", ours["dE_object"], best["dE_object"] + 0.2))
    return [(f"{figure}, {quality}", reached, allowed) for figure, reached, allowed in found]


def bars(result: Result) -> list[tuple[str, float, float]]:
    """(figure, reached, allowed) for each bar."""
    found = [bar for row in BARRED if row in result.rows for bar in bars_of(result, row)]
    if result.gain_error_percent:
        found.append(("gain error %", max(map(abs, result.gain_error_percent)), 3.0))
    return found + result.over_time


def aims(result: Result) -> list[tuple[str, float, float]]:
    """(figure, reached, allowed) for each aim: what is to be reached yet, by the best quality as well; and what a viewer
    sees against what is measured."""
    found = [("bad %, live", result.rows[row]["bad"], 1.0) for row in BARRED if row.endswith(", live") and row in result.rows]
    seen, live = result.rows.get(SHOWN), result.rows.get(LIVE)
    if seen and live:
        found.append(("s_err of live, shown", seen["s_err"], 1.15 * live["s_err"]))
        found.append(("bad % of live, shown", seen["bad"], 1.2 * live["bad"]))
        if "dE_object" in seen:
            found.append(("dE_obj of live, shown", seen["dE_object"], live["dE_object"] + 0.2))
    return found


def figures_table(results: list[Result]) -> str:
    """Markdown: one block of rows for each rig."""
    lines = ["| rig | row | " + " | ".join(title for _, title, _ in COLUMNS) + " |", "|---" * (len(COLUMNS) + 2) + "|"]
    for result in results:
        for name, row in result.rows.items():
            cells = [f"{row[c]:.{digits}f}" if c in row else "-" for c, _, digits in COLUMNS]
            bold = "**" if name in ROWS or name == SHOWN else ""
            lines.append(f"| {result.name} | {bold}{name}{bold} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def bars_table(results: list[Result]) -> tuple[str, bool]:
    """Markdown of the bars and aims, and whether all bars were reached."""
    lines, good = ["| rig | bar | reached | allowed | × | |", "|---|---|---|---|---|---|"], True

    def add(result: Result, what: str, reached: float, allowed: float, missed: str) -> bool:
        passed = reached <= allowed
        lines.append(f"| {result.name} | {what} | {reached:.4f} | {allowed:.4f} | {reached / allowed:.2f} | {'pass' if passed else missed} |")
        return passed
    for result in results:
        for bar in bars(result):
            good &= add(result, *bar, "**FAIL**")
        for aim in aims(result):
            add(result, *aim, "aim missed")
    return "\n".join(lines), good


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth", type=Path, nargs="+", default=FOLDERS, help="folders of more rigs with truth")
    parser.add_argument("--sessions", help="names of rigs, comma-separated (default: all)")
    parser.add_argument("--every", type=int, default=1, help="judge every N-th true frame of the rigs in --truth")
    parser.add_argument("--jobs", type=int, default=1, help="rigs at a time; with more than one, what a viewer sees is left out")
    parser.add_argument("--extra", action="append", default=[], metavar="ARGS", help='more arguments for replay; "NAME: ARGS" for one rig')
    parser.add_argument("--no-planes", action="store_true", help="leave out the rows of shadowing planes")
    parser.add_argument("--no-shown", action="store_true", help="leave out the rows of what a viewer sees, which depend on the machine")
    parser.add_argument("--quality", choices=["live", "best"], help="only the rows of this quality")
    parser.add_argument("--compare-only", action="store_true", help="judge the pictures of the last run again")
    parser.add_argument("--penumbra", type=Path, default=TARGET / "release/penumbra", help="the program (default: the release build)")
    parser.add_argument("--write", nargs="?", type=Path, const=RESULTS / "fidelity.md", metavar="FILE",
                        help="put the table into a document, between its comments fidelity:begin and fidelity:end (default: %(const)s)")
    parser.add_argument("--out", type=Path, default=TARGET / "fidelity", help="frames, reports, logs, table.md")
    a = parser.parse_args()
    a.out = a.out.resolve()
    return a


def chosen_rigs(a: argparse.Namespace) -> tuple[list[Rig], list[str]]:
    """The rigs to judge, and the names of those that are missing."""
    found = {rig.name: rig for rig in bundled() + [rig for folder in a.truth for rig in outside(folder, a.every)]}
    names = a.sessions.split(",") if a.sessions else [*found, *(name for name in OUTSIDE if name not in found)]
    if unknown := set(names) - set(found) - set(OUTSIDE):
        raise Failed(f"--sessions: no rig {', '.join(sorted(unknown))}; there are {', '.join(found)}")
    return [found[name] for name in names if name in found], [name for name in names if name not in found]


def written(results: list[Result], missing: list[str]) -> tuple[str, bool]:
    """The generated text, and whether all bars were reached."""
    verdict, good = bars_table(results)
    gains = [f"{r.name}: errors of the white-balance gains: " + ", ".join(f"{c} {e:+.1f} %" for c, e in zip("RGB", r.gain_error_percent))
             for r in results if r.gain_error_percent]
    skipped = [f"SKIPPED {name}: this rig is not part of the repository, and --truth has none of that name" for name in missing]
    return "\n\n".join([figures_table(results), verdict, *gains, *skipped]), good


def main() -> int:
    a = options()
    try:
        run_with(PACKAGES, REQUIREMENTS)
        rigs, missing = chosen_rigs(a)
        if not a.penumbra.exists() and not a.compare_only:
            raise Failed(f"{a.penumbra} is missing; run `make build`")
        a.out.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(a.jobs) as pool:
            outcomes = list(pool.map(lambda rig: attempt(rig, a), rigs))
        results = [result for result in outcomes if result]
        text, good = written(results, missing)
        (a.out / "table.md").write_text(text + "\n")
        print(text)
        if a.write and len(results) == len(outcomes):
            write_between(a.write, "fidelity", text)
    except (Failed, Unavailable, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    failed = len(outcomes) - len(results)
    print(f"\n{len(results)} rigs judged, {failed} failed, {len(missing)} skipped; the bars are {'reached' if good else 'NOT reached'}; {a.out / 'table.md'}")
    return 2 if failed or not results else 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

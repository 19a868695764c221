#!/usr/bin/env python3
"""Judge the program's pictures by path-traced truth, and print the table of figures.

For every session folder under --truth: `penumbra import`, `penumbra replay --headless
--speed max --frames-out`, then the folder's own `compare.py`. The program gets a view of
the session without the judge's files (truth/, masks/, light_truth/, truth_rig.json,
camera_truth.csv), so it cannot read them. Each session is replayed once more with
`--technique planes`, for a row beside the dome's; the bars are the dome's alone.

    tests/fidelity.py                                  all sessions, the table on stdout
    tests/fidelity.py --no-planes                      the dome's rows alone
    tests/fidelity.py --sessions desk,courtyard --every 4 --jobs 2
    tests/fidelity.py --extra "--lights grid" --extra "desk-marker: --config sphere.toml"

Ends with 0 when every bar is reached, 1 when one is missed, 2 when something failed.
"""
from __future__ import annotations

import argparse
import csv
import hashlib
import json
import math
import shlex
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from python_env import ROOT, TARGET, Unavailable, python_with

REQUIREMENTS = Path(__file__).with_name("requirements-judge.txt")
PACKAGES = ["numpy", "scipy", "PIL", "skimage", "flip_evaluator"]
JUDGES_ONLY = {"truth", "masks", "light_truth", "truth_rig.json", "camera_truth.csv"}
BASELINES = ("without", "unlit_mean", "blob", "truth_jpg")
# row -> ending of its files' names, more arguments for replay
DOME, PLANES = "COMPOSITE", "COMPOSITE planes"
TECHNIQUES = {DOME: ("", []), PLANES: ("-planes", ["--technique", "planes"])}
# compare.py's column, the table's heading, digits
COLUMNS = [
    ("rmse_shadow", "RMSEshd", 2), ("s_err", "s_err", 4), ("s_bias", "s_bias", 4),
    ("s_core", "s_core", 4), ("dE", "dE", 2), ("l_err", "l_err", 4),
    ("dE_lit", "dE_lit", 2), ("dE_object", "dE_obj", 2), ("flip_roi", "flip_roi", 4),
]


class Failed(Exception):
    """A step of one session failed; the text says which and where its output is."""


@dataclass
class Result:
    """Figures of one session: row name -> column -> value."""

    name: str
    rows: dict[str, dict[str, float]]
    report: dict = field(default_factory=dict)
    gain_error_percent: list[float] | None = None
    seconds: float = 0.0


def blind_view(session: Path, target: Path) -> Path:
    """A copy of all that the rig recorded, without the judge's files."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(session, target, ignore=lambda folder, names: JUDGES_ONLY & set(names), copy_function=shutil.copyfile)
    target.chmod(0o755)
    for folder in target.rglob("*"):
        folder.chmod(0o755 if folder.is_dir() else 0o644)
    return target


def step(command: list[str], log: Path, what: str) -> None:
    """Run one command, output to `log`; its last line tells what went wrong."""
    with log.open("a") as sink:
        sink.write(f"\n$ {shlex.join(command)}\n")
        sink.flush()
        code = subprocess.run(command, stdout=sink, stderr=sink).returncode
    if code:
        last = next((line for line in reversed(log.read_text().splitlines()) if line.strip()), "")
        raise Failed(f"{what} ended with {code}: {last} (see {log})")


def read_rows(path: Path) -> dict[str, dict[str, float]]:
    """Overall figures of a compare.py CSV, by its own rule (RMSE by mean square, else mean)."""
    table: dict[str, dict[str, list[float]]] = {}
    with path.open(newline="") as source:
        for line in csv.DictReader(source):
            columns = table.setdefault(line["image"], {})
            for name, _, _ in COLUMNS:
                if line.get(name) and math.isfinite(float(line[name])):
                    columns.setdefault(name, []).append(float(line[name]))
    mean = lambda v: sum(v) / len(v)
    return {
        image: {c: math.sqrt(mean([x * x for x in v])) if c.startswith("rmse") else mean(v) for c, v in columns.items()}
        for image, columns in table.items()
    }


def baselines(python: str, compare: Path, session: Path, out: Path, every: int) -> dict[str, dict[str, float]]:
    """Rows of the trivial baselines; kept, because they depend on the truth alone."""
    key = hashlib.sha256(f"{session}{every}{(session / 'rig.json').stat().st_mtime_ns}".encode()).hexdigest()[:12]
    kept = out / "baselines" / f"{session.name}-{key}.csv"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        part = kept.with_suffix(".part")
        step([python, str(compare), str(session), "--every", str(every), "--baseline-every", "1", "--csv", str(part)],
             out / session.name / "log.txt", "compare.py (baselines)")
        part.rename(kept)
    rows = read_rows(kept)
    return {name: rows[name] for name in BASELINES if name in rows}


def find_gains(report: object) -> list[float] | None:
    """The environment camera's white-balance gains in a report, wherever they stand."""
    if isinstance(report, dict):
        for key, value in report.items():
            if "gain" in key and isinstance(value, list) and len(value) == 3 and all(isinstance(x, (int, float)) for x in value):
                return [float(x) for x in value]
        for value in report.values():
            if found := find_gains(value):
                return found
    return None


def gain_error(session: Path, report: dict) -> list[float] | None:
    """Percent per channel by which the gains found miss the true ratio of the cameras' gains."""
    truth = session / "truth_rig.json"
    found = find_gains(report.get("white_balance", report))
    if found is None or not truth.exists():
        return None
    rig = json.loads(truth.read_text())
    total = [rig[camera]["response_truth"]["total_gain_rgb"] for camera in ("scene_camera", "environment_camera")]
    true = [s / e for s, e in zip(*total)]
    return [100 * (f / t - 1) for f, t in zip(found, true)]


def recorded(session: Path, work: Path, a: argparse.Namespace) -> Path:
    """The session as the program gets it."""
    mcap = work / "session.mcap"
    if not a.compare_only:
        view = blind_view(session, work / "rig")
        step([str(a.penumbra), "import", str(view), str(mcap), "--force"], work / "log.txt", "import")
    return mcap


def composed(mcap: Path, session: Path, row: str, a: argparse.Namespace) -> tuple[Path, Path]:
    """Folder of pictures and report of one replay."""
    ending, technique = TECHNIQUES[row]
    frames, report = mcap.with_name(f"frames{ending}"), mcap.with_name(f"report{ending}.json")
    if not a.compare_only:
        for old in frames.glob("*.png"):
            old.unlink()
        step([str(a.penumbra), "replay", str(mcap), "--headless", "--speed", "max", "--frames-out", str(frames),
              "--report", str(report), "--force", *technique, *extra_arguments(a.extra, session.name)],
             mcap.with_name("log.txt"), f"replay ({row})")
    return frames, report


def compared(python: str, compare: Path, session: Path, frames: Path, a: argparse.Namespace) -> dict[str, float]:
    """The truth folder's judgement of one folder of pictures."""
    result = frames.with_name(frames.name.replace("frames", "compare") + ".csv")
    step([python, str(compare), str(session), "--composites", str(frames), "--every", str(a.every),
          "--no-baselines", "--csv", str(result)], frames.with_name("log.txt"), "compare.py")
    return read_rows(result)["composite"]


def techniques(session: Path, a: argparse.Namespace) -> list[str]:
    """Rows to make; one alone where --extra chooses the technique itself."""
    chosen = any(x.split("=")[0] == "--technique" for x in extra_arguments(a.extra, session.name))
    return [DOME] if a.no_planes or chosen else [DOME, PLANES]


def judge(session: Path, a: argparse.Namespace, python: str) -> Result:
    """Everything for one session."""
    started = time.monotonic()
    work = a.out / session.name
    work.mkdir(parents=True, exist_ok=True)
    (work / "log.txt").write_text("")
    compare = a.truth / "compare.py"
    if not compare.exists():
        compare = ROOT / "../shared/truth/compare.py"
    mcap, rows, reports = recorded(session, work, a), {}, {}
    for row in techniques(session, a):
        frames, reports[row] = composed(mcap, session, row, a)
        rows[row] = compared(python, compare, session, frames, a)
    rows |= baselines(python, compare, session, a.out, a.every)
    said = json.loads(reports[DOME].read_text()) if reports[DOME].exists() else {}
    return Result(session.name, rows, said, gain_error(session, said), time.monotonic() - started)


def extra_arguments(extra: list[str], session: str) -> list[str]:
    """`--extra` for all sessions, and `--extra "NAME: ..."` for one."""
    arguments = []
    for text in extra:
        name, colon, rest = text.partition(":")
        if colon and not name.startswith("-"):
            arguments += shlex.split(rest) if name.strip() == session else []
        else:
            arguments += shlex.split(text)
    return arguments


def bars(result: Result) -> list[tuple[str, float, float]]:
    """(what, reached, allowed) for each figure of the truth folder's README, of the dome."""
    ours, without = result.rows[DOME], result.rows["without"]
    found = [
        ("s_err", ours["s_err"], without["s_err"] / 3),
        ("abs s_bias", abs(ours["s_bias"]), 0.015),
        ("dE", ours["dE"], 0.45 * without["dE"]),
    ]
    if "dE_object" in ours:
        found.append(("dE_obj", ours["dE_object"], 5.0))
    if result.name == "desk-lamp" and "l_err" in ours:
        found += [("l_err", ours["l_err"], 0.08), ("dE_lit", ours["dE_lit"], 3.0)]
    if result.gain_error_percent:
        found.append(("gain error %", max(map(abs, result.gain_error_percent)), 3.0))
    return found


def table(results: list[Result]) -> str:
    """Markdown: one block of rows a session."""
    lines = ["| folder | row | " + " | ".join(title for _, title, _ in COLUMNS) + " |", "|---" * (len(COLUMNS) + 2) + "|"]
    for result in results:
        for name, row in result.rows.items():
            cells = [f"{row[c]:.{digits}f}" if c in row else "-" for c, _, digits in COLUMNS]
            bold = "**" if name in TECHNIQUES else ""
            lines.append(f"| {result.name} | {bold}{name}{bold} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def verdicts(results: list[Result]) -> tuple[str, bool]:
    """Markdown of the bars, and whether all were reached."""
    lines, good = ["| folder | bar | reached | allowed | × | |", "|---|---|---|---|---|---|"], True
    for result in results:
        for what, reached, allowed in bars(result):
            passed = reached <= allowed
            good &= passed
            lines.append(f"| {result.name} | {what} | {reached:.4f} | {allowed:.4f} | {reached / allowed:.2f} | {'pass' if passed else '**FAIL**'} |")
    return "\n".join(lines), good


def write_between(document: Path, mark: str, text: str) -> None:
    """Replaces what stands between two comments of a document."""
    begin, end = f"<!-- {mark}:begin -->", f"<!-- {mark}:end -->"
    before, _, rest = document.read_text().partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise Failed(f"{document} has no {begin} ... {end}")
    document.write_text(f"{before}{begin}\n{text}\n{end}{after}")


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth", type=Path, default=ROOT / "../shared/truth", help="folder of session folders")
    parser.add_argument("--sessions", help="names, comma-separated (default: all)")
    parser.add_argument("--every", type=int, default=1, help="judge every N-th truth frame")
    parser.add_argument("--jobs", type=int, default=1, help="sessions at a time")
    parser.add_argument("--extra", action="append", default=[], metavar="ARGS", help='more arguments for replay; "NAME: ARGS" for one session')
    parser.add_argument("--no-planes", action="store_true", help="leave out the rows of shadowing planes")
    parser.add_argument("--compare-only", action="store_true", help="judge the frames of the last run again")
    parser.add_argument("--penumbra", type=Path, help="the program (default: the release build)")
    parser.add_argument("--python", help="a Python with compare.py's packages")
    parser.add_argument("--write", action="store_true", help="put the table into ARCHITECTURE.md")
    parser.add_argument("--out", type=Path, default=TARGET / "fidelity", help="frames, reports, table.md")
    a = parser.parse_args()
    a.truth, a.out = a.truth.resolve(), a.out.resolve()
    a.penumbra = a.penumbra or TARGET / "release/penumbra"
    return a


def sessions(a: argparse.Namespace) -> list[Path]:
    """The folders to judge."""
    found = sorted(p.parent for p in a.truth.glob("*/rig.json") if (p.parent / "truth").is_dir())
    if not a.sessions:
        return found
    names = a.sessions.split(",")
    unknown = set(names) - {p.name for p in found}
    if unknown:
        raise Failed(f"{a.truth}: no session {', '.join(sorted(unknown))}; there are {', '.join(p.name for p in found)}")
    return [p for p in found if p.name in names]


def attempt(session: Path, a: argparse.Namespace, python: str) -> Result | Failed:
    try:
        result = judge(session, a, python)
        print(f"{session.name}: {result.seconds:.0f} s", file=sys.stderr)
        return result
    except (Failed, OSError, KeyError, ValueError) as error:
        failure = error if isinstance(error, Failed) else Failed(f"{type(error).__name__}: {error}")
        print(f"{session.name}: {failure}", file=sys.stderr)
        return failure


def main() -> int:
    a = options()
    if not a.truth.is_dir():
        print(f"SKIPPED fidelity: {a.truth} is missing")
        return 0
    try:
        chosen = sessions(a)
        a.out.mkdir(parents=True, exist_ok=True)
        python = python_with(PACKAGES, REQUIREMENTS, a.python)
        if not a.penumbra.exists() and not a.compare_only:
            raise Failed(f"{a.penumbra} is missing; run `make build`")
    except (Failed, Unavailable) as error:
        print(error, file=sys.stderr)
        return 2
    with ThreadPoolExecutor(a.jobs) as pool:
        outcomes = list(pool.map(lambda s: attempt(s, a, python), chosen))
    results = [r for r in outcomes if isinstance(r, Result)]
    found, good = verdicts(results)
    gains = [f"{r.name}: white-balance gains off by " + ", ".join(f"{c} {e:+.1f} %" for c, e in zip("RGB", r.gain_error_percent))
             for r in results if r.gain_error_percent]
    text = "\n\n".join([table(results), found, *gains])
    (a.out / "table.md").write_text(text + "\n")
    print(text)
    if a.write and len(results) == len(outcomes):
        write_between(ROOT / "ARCHITECTURE.md", "fidelity", text)
    failed = len(outcomes) - len(results)
    print(f"\n{len(results)} sessions judged, {failed} failed; the bars are {'reached' if good else 'NOT reached'}; {a.out / 'table.md'}")
    return 2 if failed or not results else 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

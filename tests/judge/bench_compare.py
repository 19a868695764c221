#!/usr/bin/env python3
"""Build another revision and run its benchmark and this one's in turns.

    tests/judge/bench_compare.py REV [--cases supan,live] [--pairs 7]

Each pair runs both programs once, in alternating order, so that changes of the machine's speed
affect both alike. The table, in Markdown, has the median of the pairs' ratios of the time per
picture (this program / REV; above 1 is slower), its confidence interval by order statistics, and the
passes whose time changed most.
"""
from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from python_env import ROOT, TARGET

CASES = ["supan", "kakuta2007", "kakuta2004", "lightprobe", "live"]
#: What makes rows of two reports comparable.
KEY = ("case", "width", "height", "lights", "refreshed_per_frame", "planes", "light_changes", "triangles", "lamps",
       "environment", "max_wait_ms", "samples")
#: Confidence that the interval should have.
CONFIDENCE = 0.95
#: Passes named per row.
PASSES = 3


class Failed(Exception):
    """The comparison is impossible; the message gives the reason and a remedy."""


@dataclass
class Times:
    """Milliseconds per picture of one run: of all, and of each pass."""
    picture: float
    passes: dict[str, float]


@dataclass
class Side:
    """One of the two programs: its runs by row, and the reasons why cases failed."""
    name: str
    program: Path
    runs: dict[tuple, dict[int, Times]] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)

    def measure(self, case: str, pair: int, arguments: list[str]) -> None:
        """Runs one case once."""
        if case in self.failures:
            return
        with tempfile.TemporaryDirectory() as folder:
            report = Path(folder) / "report.json"
            command = [str(self.program), "bench", "--case", case, "--json", str(report), *arguments]
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, check=False)
            if done.returncode or not report.exists():
                self.failures[case] = failure(done)
                return
            for key, times in rows(json.loads(report.read_text())):
                self.runs.setdefault(key, {})[pair] = times


def failure(done: subprocess.CompletedProcess[str]) -> str:
    """Why a run failed; clap ends with 2 if it does not know the case or an argument."""
    lines = [line for line in done.stderr.splitlines() if line.strip()] or [f"ended with {done.returncode}"]
    return "has no such case" if "for '--case" in lines[0] else lines[0].removeprefix("error: ")


def rows(report: dict) -> list[tuple[tuple, Times]]:
    """Key and times of each row; equal configurations are numbered."""
    found: list[tuple[tuple, Times]] = []
    for r in [*report.get("rows", []), *report.get("live", [])]:
        # A revision that does not know a field has none of it.
        configuration = tuple((name, r[name]) for name in KEY if r.get(name))
        before = sum(1 for key, _ in found if key[0] == configuration)
        total = r["wall_ms"] if "wall_ms" in r else r["arrival_to_picture_ms"]
        found.append(((configuration, before), Times(total["p50"], {p["name"]: p["ms"] for p in r.get("passes", [])})))
    return found


def interval(ratios: list[float]) -> tuple[float, float, float]:
    """Lower and upper bound of the median, and the confidence of that interval.

    Order statistics (David and Nagaraja 2003, 7.1): the k-th smallest and largest of n values enclose the median
    with probability 1 - 2 P(B < k), B binomial(n, 1/2). Takes the narrowest interval that reaches CONFIDENCE, or the range.
    """
    ordered, n = sorted(ratios), len(ratios)
    covered = lambda k: 1 - 2 * sum(math.comb(n, i) for i in range(k)) / 2**n  # noqa: E731
    k = max([k for k in range(1, (n + 1) // 2 + 1) if covered(k) >= CONFIDENCE], default=1)
    return ordered[k - 1], ordered[n - k], max(covered(k), 0.0)


def label(key: tuple) -> str:
    """The configuration of a row in words."""
    r = dict(key[0])
    text = f"{r['case']} {r['width']}×{r['height']}"
    names = {"lights": "lights", "refreshed_per_frame": "redrawn", "planes": "planes", "triangles": "triangles", "lamps": "lamps",
             "samples": "samples"}
    text += "".join(f", {r[name]} {word}" for name, word in names.items() if r.get(name))
    if r.get("planes"):
        text += ", light " + ("changing" if r.get("light_changes") else "steady")
    text += f", light from the {r['environment']}" if r.get("environment") else ""
    text += f", waits {r['max_wait_ms']:g} ms" if r.get("max_wait_ms") else ""
    return text + (f" ({key[1] + 1})" if key[1] else "")


def verdict(low: float, high: float) -> str:
    """What the interval says."""
    return "slower" if low > 1 else "faster" if high < 1 else "no difference seen"


def changed_passes(ours: list[Times], theirs: list[Times]) -> str:
    """The passes whose median changed most."""
    def medians(runs: list[Times]) -> dict[str, float]:
        return {name: median(r.passes.get(name, 0.0) for r in runs) for name in {n for r in runs for n in r.passes}}
    here, there = medians(ours), medians(theirs)
    both = sorted({*here, *there}, key=lambda name: (-abs(here.get(name, 0) - there.get(name, 0)), name))[:PASSES]
    shown = lambda times, name: f"{times[name]:.2f}" if name in times else "none"  # noqa: E731
    return ", ".join(f"{name} {shown(there, name)} → {shown(here, name)}" for name in both)


def row(key: tuple, ours: dict[int, Times], theirs: dict[int, Times], names: tuple[str, str]) -> str:
    """One line of the table."""
    pairs = sorted(ours.keys() & theirs.keys())
    if not pairs:
        lacking = names[1] if ours else names[0]
        return f"| {label(key)} | | | | | {lacking} has no such row | |"
    here, there = [ours[p] for p in pairs], [theirs[p] for p in pairs]
    ratios = [h.picture / t.picture for h, t in zip(here, there)]
    low, high, confidence = interval(ratios)
    cells = [label(key), f"{median(t.picture for t in there):.2f}", f"{median(h.picture for h in here):.2f}", f"{median(ratios):.3f}",
             f"{low:.3f} to {high:.3f} ({100 * confidence:.0f} %)", verdict(low, high), changed_passes(here, there)]
    return "| " + " | ".join(cells) + " |"


def table(ours: Side, theirs: Side) -> str:
    """The complete table, with a line for each case that failed."""
    lines = [f"| configuration | {theirs.name}, ms | {ours.name}, ms | ratio | interval of the median | | most changed passes, ms |",
             "|---|---|---|---|---|---|---|"]
    for key in dict.fromkeys([*ours.runs, *theirs.runs]):
        case = dict(key[0])["case"]
        if any(case in side.failures for side in (ours, theirs)):
            continue
        lines.append(row(key, ours.runs.get(key, {}), theirs.runs.get(key, {}), (ours.name, theirs.name)))
    for side in (ours, theirs):
        lines += [f"| {case} | | | | | {side.name}: {reason} | |" for case, reason in side.failures.items()]
    return "\n".join(lines)


def compare(ours: Side, theirs: Side, cases: list[str], pairs: int, arguments: list[str]) -> str:
    """Measures pair by pair, in alternating order, and returns the table."""
    for case in cases:
        for pair in range(pairs):
            print(f"bench_compare: {case}, pair {pair + 1} of {pairs}", file=sys.stderr)
            for side in (ours, theirs) if pair % 2 else (theirs, ours):
                side.measure(case, pair, arguments)
            if case in ours.failures or case in theirs.failures:
                break
    return table(ours, theirs)


def git(*arguments: str) -> str:
    """Output of git, or Failed."""
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["failed"]
        raise Failed(f"git {arguments[0]}: {lines[-1]}")
    return done.stdout.strip()


def build(revision: str, folder: Path) -> Side:
    """Builds a revision in a worktree below `folder`, with a target folder that all revisions share."""
    if not revision:
        raise Failed("name the other revision: REV=HEAD~1")
    commit = git("rev-parse", "--verify", f"{revision}^{{commit}}")
    tree, target = folder / "tree", folder / "target"
    git("worktree", "prune")
    if tree.exists():
        git("worktree", "remove", "--force", str(tree))
    git("worktree", "add", "--detach", "--force", str(tree), commit)
    try:
        command = ["cargo", "build", "--release", "--locked", "--bin", "penumbra"]
        if subprocess.run(command, cwd=tree, env={**os.environ, "CARGO_TARGET_DIR": str(target)}, check=False).returncode:
            raise Failed(f"{revision} does not build")
    finally:
        git("worktree", "remove", "--force", str(tree))
    # Another build overwrites it.
    program = folder / f"penumbra-{commit[:12]}"
    shutil.copy2(target / "release/penumbra", program)
    return Side(commit[:9], program)


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", metavar="REV", help="revision of git to compare with")
    parser.add_argument("--penumbra", type=Path, default=TARGET / "release/penumbra", help="program of this revision; default: %(default)s")
    parser.add_argument("--other", type=Path, help="program of REV, if it is built already")
    parser.add_argument("--cases", default=",".join(CASES), help="cases of the benchmark; default: %(default)s")
    parser.add_argument("--pairs", type=int, default=7, help="runs of each program and case; an interval of 95 %% needs 6; default: %(default)s")
    parser.add_argument("--bench", nargs=argparse.REMAINDER, default=[], metavar="ARGUMENT", help="last: arguments of `penumbra bench`")
    return parser.parse_args()


def main() -> int:
    a = options()
    try:
        if a.pairs < 1:
            raise Failed("--pairs: at least 1")
        theirs = Side(a.revision, a.other.resolve()) if a.other else build(a.revision, TARGET.resolve() / "bench-compare")
        text = compare(Side("this", a.penumbra.resolve()), theirs, a.cases.split(","), a.pairs, a.bench)
    except (Failed, OSError, KeyError, ValueError) as error:
        reason = error if isinstance(error, Failed) else f"{type(error).__name__}: {error}"
        print(f"bench_compare: {reason}", file=sys.stderr)
        return 2
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())

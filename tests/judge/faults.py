#!/usr/bin/env python3
"""Inject every kind of fault many times into a live rig, and write the table of the documentation: `make faults`.

    tests/judge/faults.py [--rounds 100] [--only KIND] [--write]

The rig is that of tests/faults, which `make test` runs with one round. Exit status: 0, 1 if a figure is not reached, 2 if the
run failed.
"""
from __future__ import annotations

import argparse
import datetime
import json
import os
import subprocess
import sys
from pathlib import Path

from python_env import ROOT, TARGET
from tables import RESULTS, write_between

#: The figures to reach, milliseconds.
MAX_GAP, MAX_RECOVERY = 500, 2000
HEADING = "| fault | of | injections | cause named | largest gap, ms | recovered | slowest recovery, ms |"


def line(row: dict) -> str:
    """One line of the table."""
    slowest = f"{row['slowest_recovery_ms']:.0f}" if row["recovered"] else ""
    cells = [row["kind"], row["place"].replace("-", " "), row["injections"], row["named"], f"{row['largest_gap_ms']:.0f}", row["recovered"], slowest]
    return "| " + " | ".join(map(str, cells)) + " |"


def total(rows: list[dict]) -> dict:
    """All rows together."""
    sums = {key: sum(row[key] for row in rows) for key in ("injections", "named", "recovered")}
    largest = {key: max(row[key] for row in rows) for key in ("largest_gap_ms", "slowest_recovery_ms")}
    return {"kind": "all", "place": "", **sums, **largest}


def table(results: dict, machine: str) -> str:
    """The table with what was measured beside it. Rows of one kind are together."""
    kinds = list(dict.fromkeys(row["kind"] for row in results["rows"]))
    rows = sorted(results["rows"], key=lambda row: (kinds.index(row["kind"]), row["place"]))
    growth = results["growth"]
    memory, threads, descriptors = (" to ".join(f"{value:.{digits}f}" for value in growth[key]) for key, digits in
                                    (("memory_mb", 1), ("threads", 0), ("descriptors", 0)))
    return "\n".join([
        f"{machine}: {results['pictures']:,} pictures in {results['seconds'] / 60:.0f} minutes.",
        f"After the first fifth of the run: memory {memory} MB by its regression line; at most {threads} threads and",
        f"{descriptors} file descriptors, from the first half to the second.",
        "", HEADING, "|---|---|---|---|---|---|---|", *map(line, rows), line(total(rows)),
    ])


def missed(results: dict) -> list[str]:
    """The figures that were not reached."""
    texts = []
    for row in results["rows"]:
        name = f"{row['kind']} of the {row['place']}"
        for key, what in (("named", "named"), ("recovered", "recovered")):
            if row[key] < row["injections"]:
                texts.append(f"{name}: {row[key]} of {row['injections']} {what}")
        for key, limit in (("largest_gap_ms", MAX_GAP), ("slowest_recovery_ms", MAX_RECOVERY)):
            if row[key] > limit:
                texts.append(f"{name}: {key} {row[key]:.0f}, allowed {limit}")
    return texts


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=100, help="injections of each kind (default: %(default)s)")
    parser.add_argument("--only", metavar="KIND", help="one kind, as the table names it")
    parser.add_argument("--write", action="store_true", help="put the table into docs/src/results/faults.md")
    a = parser.parse_args()
    out = Path(TARGET).absolute() / "faults.json"
    out.unlink(missing_ok=True)
    environment = {**os.environ, "PENUMBRA_FAULTS_ROUNDS": str(a.rounds), "PENUMBRA_FAULTS_OUT": str(out)}
    if a.only:
        environment["PENUMBRA_FAULTS_ONLY"] = a.only
    # Of the whole workspace, because Cargo would build many packages again with the fewer features of one.
    command = ["cargo", "test", "--workspace", "--locked", "--test", "faults", "--", "--nocapture"]
    outcome = subprocess.run(command, cwd=ROOT, env=environment, check=False)
    if not out.exists():
        print("faults: the run ended before its results", file=sys.stderr)
        return 2
    results = json.loads(out.read_text())
    machine = f"{datetime.date.today()}, {results['adapter']}, {os.cpu_count()} processors"
    text = table(results, machine)
    print(text)
    if a.write and not a.only:
        write_between(RESULTS / "faults.md", "faults", text)
    for what in missed(results):
        print(f"MISSED {what}")
    return 1 if outcome.returncode or missed(results) else 0


if __name__ == "__main__":
    sys.exit(main())

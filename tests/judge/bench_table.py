#!/usr/bin/env python3
"""Put the figures of `penumbra bench --json FILE` into a table of the documentation.

    tests/judge/bench_table.py FILE... [--write DOCUMENT]

The table replaces the text between the document's comments bench:begin and bench:end.
"""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from tables import RESULTS, write_between

HEADING = "| adapter | size | lights | maps per frame | frames/s | wall ms p50 | p99 | GPU ms p50 | p99 | longest passes, ms |"
LIVE_HEADING = ("| live rig | size | lights | samples a pixel | waits for poses, ms | frames/s | arrival to picture, ms p50 | p99 "
                "| compose, ms p50 | p99 |")


def row(adapter: str, r: dict) -> str:
    """One line of the table."""
    longest = sorted(r["passes"], key=lambda p: -p["ms"])[:3]
    size, work = f"{r['width']}×{r['height']}", r["refreshed_per_frame"]
    if r["planes"]:
        light = "changing" if r["light_changes"] else "steady"
        size, work = f"{r['case']}, {size}, {r['triangles']:,} triangles", f"none: {r['planes']} planes, {r['basis_images']} basis images, light {light}"
    if r["environment"]:
        lamps = f"{r['lamps']} lamp" + "s" * (r["lamps"] != 1)
        size, work = f"{r['case']}, {size}, {r['triangles']:,} triangles", f"{work}; {lamps}, light from the {r['environment']}"
        if r["processor_ms"]:
            work += f"; {r['processor_ms']:.0f} ms of processor time"
        # Light that is computed beside the pictures is not a stage of theirs.
        longest = [*(p for p in r["stages"] if p["name"] == "light"), *longest]
    cells = [adapter, size, r["lights"], work, f"{r['fps']:.1f}"]
    cells += [f"{r[kind][q]:.2f}" for kind in ("wall_ms", "gpu_ms") for q in ("p50", "p99")]
    return "| " + " | ".join(map(str, [*cells, ", ".join(f"{p['name']} {p['ms']:.2f}" for p in longest)])) + " |"


def live_row(adapter: str, r: dict) -> str:
    """One line of the table of live rigs."""
    times = [f"{r[kind][q]:.1f}" for kind in ("arrival_to_picture_ms", "total_ms") for q in ("p50", "p99")]
    cells = [adapter, f"{r['width']}×{r['height']}", r["lights"], r["samples"], f"{r['max_wait_ms']:.0f}", f"{r['frames_per_second']:.1f}", *times]
    return "| " + " | ".join(map(str, cells)) + " |"


def table(files: list[Path]) -> str:
    """All rows of all files."""
    reports = [json.loads(file.read_text()) for file in files]
    live = [live_row(report["adapter"], r) for report in reports for r in report["live"]]
    lines = [HEADING, "|---" * 10 + "|", *(row(report["adapter"], r) for report in reports for r in report["rows"])]
    return "\n".join(lines + (["", LIVE_HEADING, "|---" * 10 + "|", *live] if live else []))


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reports", nargs="+", type=Path, metavar="FILE", help="made by `penumbra bench --json FILE`")
    parser.add_argument("--write", type=Path, default=RESULTS / "bench.md", metavar="DOCUMENT", help="default: %(default)s")
    return parser.parse_args()


def main() -> int:
    a = options()
    try:
        text = table(a.reports)
        write_between(a.write, "bench", text)
    except (OSError, KeyError, ValueError) as error:
        print(f"bench_table: {type(error).__name__}: {error}", file=sys.stderr)
        return 2
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())

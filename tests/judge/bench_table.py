#!/usr/bin/env python3
"""Put the figures of `penumbra bench --json FILE` into a table of the documentation.

    tests/judge/bench_table.py FILE... [--write DOCUMENT] [--mark bench-gpu] [--start PENUMBRA SESSION]

The tables replace the text between the document's comments bench:begin and bench:end, or those of --mark. The last one holds
the figures of a software driver to the aims for two processors. With --start it also has how long a program takes from its
start to the end of a replay of one picture.
"""
from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
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


def supan(lights: int, redrawn: int) -> Callable[[dict], bool]:
    return lambda r: not r["planes"] and not r["environment"] and (r["lights"], r["refreshed_per_frame"]) == (lights, redrawn)


def kakuta(changes: bool) -> Callable[[dict], bool]:
    return lambda r: r["case"] == "kakuta2007" and r["triangles"] == 58500 and r["light_changes"] == changes


def live(width: int, lights: int, max_wait_ms: float) -> Callable[[dict], bool]:
    return lambda r: (r["width"], r["lights"], r["samples"], r["max_wait_ms"]) == (width, lights, 4, max_wait_ms)


#: What, which row, its figure, the aim; a figure that has to be small has its aim negated.
Aim = tuple[str, Callable[[dict], bool], Callable[[dict], float], float]
AIMS: list[Aim] = [
    ("supan, 64 lights, one map redrawn: frames/s", supan(64, 1), lambda r: r["fps"], 30),
    ("supan, 64 lights, all redrawn: frames/s", supan(64, 64), lambda r: r["fps"], 8),
    ("kakuta2007, light steady: frames/s", kakuta(False), lambda r: r["fps"], 35),
    ("kakuta2007, light changing: frames/s", kakuta(True), lambda r: r["fps"], 25),
    ("lightprobe, one lamp: frames/s", lambda r: bool(r["environment"]) and r["lamps"] == 1 and r["lights"] == 0, lambda r: r["fps"], 40),
]
LIVE_AIMS: list[Aim] = [
    ("live, 640×480, 64 lights: arrival to picture, ms p50", live(640, 64, 20), lambda r: r["arrival_to_picture_ms"]["p50"], -20),
    ("live, 640×480, 64 lights: arrival to picture, ms p99", live(640, 64, 20), lambda r: r["arrival_to_picture_ms"]["p99"], -33),
    ("live, 1280×720, 8 lights: frames/s", live(1280, 8, 20), lambda r: r["frames_per_second"], 15),
    ("live, 1280×720, 64 lights: frames/s", live(1280, 64, 20), lambda r: r["frames_per_second"], 15),
]
#: Name of a start, whether the driver may keep shaders, and the aim, seconds.
STARTS = [("start to the end of one picture, shaders kept, s", True, 2.0), ("the same without kept shaders, s", False, 6.0)]


def aims(rows: list[dict], rigs: list[dict], starts: Sequence[tuple[str, float, float]]) -> list[str]:
    """Lines of the table of aims, as far as their rows were measured."""
    found = [(what, figure(row), abs(aim), aim < 0)
             for measured, wanted in ((rows, AIMS), (rigs, LIVE_AIMS))
             for what, chosen, figure, aim in wanted
             for row in filter(None, [next(filter(chosen, measured), None)])]
    few, many = (next(filter(supan(lights, 1), rows), None) for lights in (8, 64))
    if few and many:
        found.append(("supan, 64 lights as a share of 8 lights", many["fps"] / few["fps"], 0.85, False))
    found += [(what, seconds, aim, True) for what, seconds, aim in starts]
    return [f"| {what} | {reached:.2f} | {aim:g} | {'reached' if (reached <= aim if small else reached >= aim) else 'not reached'} |"
            for what, reached, aim, small in found]


def measured_starts(penumbra: str, session: str) -> list[tuple[str, float, float]]:
    """Medians over five starts each; the first one of all is not counted."""
    def seconds(kept: bool) -> float:
        environment = os.environ | ({} if kept else {"MESA_SHADER_CACHE_DISABLE": "true"})
        begun = time.monotonic()
        subprocess.run([penumbra, "replay", session, "--headless", "--listen", "127.0.0.1:0", "--frames", "1"], check=True,
                       env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return time.monotonic() - begun
    seconds(True)
    return [(what, statistics.median(seconds(kept) for _ in range(5)), aim) for what, kept, aim in STARTS]


def table(files: list[Path], starts: Sequence[tuple[str, float, float]] = ()) -> str:
    """All rows of all files, and the aims."""
    reports = [json.loads(file.read_text()) for file in files]
    live_rows = [live_row(report["adapter"], r) for report in reports for r in report["live"]]
    lines = [HEADING, "|---" * 10 + "|", *(row(report["adapter"], r) for report in reports for r in report["rows"])]
    if live_rows:
        lines += ["", LIVE_HEADING, "|---" * 10 + "|", *live_rows]
    rows, rigs = ([r for report in reports for r in report[kind]] for kind in ("rows", "live"))
    lost = [report["recovery_seconds"] for report in reports if report.get("recovery_seconds") is not None]
    starts = [*starts, *(("graphics device lost in a live rig: s until the next picture", s, 2.0) for s in lost[:1])]
    goals = aims(rows, rigs, starts) if all(report["software"] for report in reports) else aims([], [], starts)
    return "\n".join(lines + (["", "| aim | reached | aimed at | |", "|---" * 4 + "|", *goals] if goals else []))


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reports", nargs="+", type=Path, metavar="FILE", help="made by `penumbra bench --json FILE`")
    parser.add_argument("--write", type=Path, default=RESULTS / "bench.md", metavar="DOCUMENT", help="default: %(default)s")
    parser.add_argument("--mark", default="bench", help="name of the comments; default: %(default)s")
    parser.add_argument("--start", nargs=2, metavar=("PENUMBRA", "SESSION"), help="measure starts, too")
    return parser.parse_args()


def main() -> int:
    a = options()
    try:
        text = table(a.reports, measured_starts(*a.start) if a.start else [])
        write_between(a.write, a.mark, text)
    except (OSError, KeyError, ValueError, subprocess.CalledProcessError) as error:
        print(f"bench_table: {type(error).__name__}: {error}", file=sys.stderr)
        return 2
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())

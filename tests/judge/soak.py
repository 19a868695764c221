#!/usr/bin/env python3
"""Check that memory stays constant over a looped replay of many frames. Long, therefore separate: `make soak`.

    tests/judge/soak.py PENUMBRA SESSION.mcap [--frames 10000] [--pieces 1] [--log FILE] [replay arguments...]
    tests/judge/soak.py --summary [--write] [--log FILE]

Reads the resident memory from /proc and the number of composed pictures from /metrics. The first tenth of the frames
fills caches; over the rest, the regression line through the samples may rise by --allow-mb in total.

A piece is one run of the program. With --log each piece adds a line to the file, also one that Ctrl-C ends early, so
a million frames can be reached in pieces; --summary adds them up and --write puts them into the documentation.
"""
from __future__ import annotations

import argparse
import csv
import dataclasses
import datetime
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from statistics import linear_regression, median

from tables import RESULTS, write_between

COMPOSED = re.compile(r"^penumbra_frames_composed_total(?:\{[^}]*\})? (\d+)", re.M)
STALLED_SECONDS = 120
#: Samples that a regression line needs.
MIN_SAMPLES = 5


@dataclasses.dataclass(frozen=True)
class Piece:
    """One run: all its frames, those after warming up, and the line through the memory of these."""

    date: str
    frames: int
    measured: int
    start_mb: float
    end_mb: float

    @property
    def growth_percent(self) -> float:
        return 100 * (self.end_mb / self.start_mb - 1)


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def composed(port: int) -> int | None:
    """Returns the number of composed pictures; None while the program is not reachable."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5) as answer:
            found = COMPOSED.search(answer.read().decode())
            return int(found[1]) if found else None
    except OSError:
        return None


def resident_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise ProcessLookupError(pid)


def sample(process: subprocess.Popen, port: int, frames: int, every: float) -> list[tuple[int, float]]:
    """Samples (pictures composed, MB) until `frames` are composed, or until Ctrl-C or SIGTERM."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    samples: list[tuple[int, float]] = []
    moved = time.monotonic()
    try:
        while not samples or samples[-1][0] < frames:
            time.sleep(every)
            if process.poll() is not None:
                sys.exit(f"soak: replay ended by itself with {process.returncode}")
            done = composed(port)
            if done is not None and (not samples or done > samples[-1][0]):
                moved = time.monotonic()
                samples.append((done, resident_mb(process.pid)))
                print(f"{done:7d} frames  {samples[-1][1]:8.1f} MB", flush=True)
            elif time.monotonic() - moved > STALLED_SECONDS:
                sys.exit(f"soak: no new picture for {STALLED_SECONDS} s after {samples[-1][0] if samples else 0} frames")
    except KeyboardInterrupt:
        print("soak: this piece ends early")
    return samples


def fit(samples: list[tuple[int, float]], warm_up: int) -> Piece:
    """The regression line through the samples after `warm_up` frames."""
    warm = [(n, mb) for n, mb in samples if n >= warm_up]
    if len(warm) < MIN_SAMPLES:
        sys.exit(f"soak: only {len(warm)} samples after warming up; take more frames or a shorter --every")
    line = linear_regression([n for n, _ in warm], [mb for _, mb in warm])
    start, end = (line.intercept + line.slope * n for n in (warm[0][0], warm[-1][0]))
    return Piece(datetime.date.today().isoformat(), warm[-1][0], warm[-1][0] - warm[0][0], round(start, 2), round(end, 2))


def run_piece(a: argparse.Namespace, config: Path, more: list[str]) -> Piece:
    """Replays the session until the frames of a piece are composed."""
    port = free_port()
    command = [str(a.penumbra), "replay", str(a.session), "--config", str(config), "--loop", "--headless", "--speed", "max", "--listen", f"127.0.0.1:{port}", *more]
    # Its own group: Ctrl-C is for this script.
    process = subprocess.Popen(command, process_group=0)
    try:
        samples = sample(process, port, a.frames, a.every)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
    # A tenth of what was composed: the piece may have ended early.
    return fit(samples, (samples[-1][0] if samples else 0) // 10)


def append(log: Path, piece: Piece) -> None:
    is_new = not log.exists()
    with log.open("a", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        if is_new:
            lines.writerow(field.name for field in dataclasses.fields(Piece))
        lines.writerow(dataclasses.astuple(piece))


def read(log: Path) -> list[Piece]:
    with log.open(newline="") as file:
        return [Piece(r["date"], int(r["frames"]), int(r["measured"]), float(r["start_mb"]), float(r["end_mb"])) for r in csv.DictReader(file)]


def summary(pieces: list[Piece]) -> str:
    """The table of the documentation: a line for each day, and one for all."""
    lines = ["| day | pieces | frames | longest piece | MB after warming up | MB at the end | growth, %: mean by frames | median | largest |", "|---|---|---|---|---|---|---|---|---|"]
    days = {day: [p for p in pieces if p.date == day] for day in sorted({p.date for p in pieces})}
    for name, of in [*days.items(), ("all", pieces)]:
        growth = [p.growth_percent for p in of]
        mean = sum(p.growth_percent * p.frames for p in of) / sum(p.frames for p in of)
        start, end = median(p.start_mb for p in of), median(p.end_mb for p in of)
        lines.append(f"| {name} | {len(of)} | {sum(p.frames for p in of):,} | {max(p.frames for p in of):,} | {start:.1f} | {end:.1f} | {mean:+.2f} | {median(growth):+.2f} | {max(growth):+.2f} |")
    return "\n".join(lines)


def arguments() -> tuple[argparse.Namespace, list[str]]:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("penumbra", type=Path, nargs="?")
    parser.add_argument("session", type=Path, nargs="?")
    parser.add_argument("--frames", type=int, default=10_000, help="frames of a piece")
    parser.add_argument("--pieces", type=int, default=1)
    parser.add_argument("--every", type=float, default=2.0, help="seconds between samples")
    parser.add_argument("--allow-mb", type=float, default=8.0)
    parser.add_argument("--light-count", type=int, help="dome lights (default: the program's)")
    parser.add_argument("--log", type=Path, help="CSV file to which each piece adds a line")
    parser.add_argument("--summary", action="store_true", help="add up the log's pieces, run none")
    parser.add_argument("--write", action="store_true", help="put the summary into docs/src/results/unattended.md")
    a, more = parser.parse_known_args()
    if (a.summary or a.write) and not a.log:
        parser.error("--summary and --write need --log")
    if not a.summary and not a.session:
        parser.error("name the program and a session")
    return a, more


def run_pieces(a: argparse.Namespace, more: list[str]) -> bool:
    """Runs the pieces; returns whether memory stayed constant in each."""
    are_flat = True
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as config:
        # Hard shadows: soft ones would take hours on a software driver.
        config.write("[shadows]\nsoft = false\n")
        if a.light_count:
            config.write(f"[environment]\nlight_count = {a.light_count}\n")
        config.flush()
        for _ in range(a.pieces):
            piece = run_piece(a, Path(config.name), more)
            if a.log:
                append(a.log, piece)
            is_flat = piece.end_mb - piece.start_mb <= a.allow_mb
            are_flat &= is_flat
            print(f"soak: {piece.frames} frames, {piece.end_mb:.1f} MB at the end, grown by {piece.end_mb - piece.start_mb:+.1f} MB ({piece.growth_percent:+.2f} %) of {a.allow_mb:g} MB allowed: {'flat' if is_flat else 'NOT flat'}", flush=True)
            if piece.frames < a.frames:
                break
    return are_flat


def main() -> int:
    a, more = arguments()
    are_flat = a.summary or run_pieces(a, more)
    if a.log:
        text = summary(read(a.log))
        print(text)
        if a.write:
            write_between(RESULTS / "unattended.md", "soak", text)
    return 0 if are_flat else 1


if __name__ == "__main__":
    sys.exit(main())

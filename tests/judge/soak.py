#!/usr/bin/env python3
"""Check that memory stays constant over a looped replay of many frames. Long, therefore separate: `make soak`.

    tests/judge/soak.py PENUMBRA SESSION.mcap [--frames 10000] [replay arguments...]

Reads the resident memory from /proc and the number of composed pictures from /metrics. The
first tenth of the frames fills caches; over the rest, the regression line through the samples
may rise by --allow-mb in total.
"""
from __future__ import annotations

import argparse
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from statistics import linear_regression

COMPOSED = re.compile(r"^penumbra_frames_composed_total(?:\{[^}]*\})? (\d+)", re.M)
STALLED_SECONDS = 120


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
    """Samples (pictures composed, MB) until `frames` are composed."""
    samples: list[tuple[int, float]] = []
    moved = time.monotonic()
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
    return samples


def growth_mb(samples: list[tuple[int, float]], frames: int) -> float:
    """Returns the rise of the regression line through the samples after the first tenth."""
    warm = [(n, mb) for n, mb in samples if n >= frames / 10]
    if len(warm) < 5:
        sys.exit(f"soak: only {len(warm)} samples after warming up; take more frames or a shorter --every")
    line = linear_regression([n for n, _ in warm], [mb for _, mb in warm])
    return line.slope * (warm[-1][0] - warm[0][0])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("penumbra", type=Path)
    parser.add_argument("session", type=Path)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--every", type=float, default=2.0, help="seconds between samples")
    parser.add_argument("--allow-mb", type=float, default=8.0)
    a, more = parser.parse_known_args()
    port = free_port()
    # Hard shadows: soft ones would take hours on a software driver.
    config = tempfile.NamedTemporaryFile("w", suffix=".toml")
    config.write('[shadows]\nsoft = false\n')
    config.flush()
    command = [str(a.penumbra), "replay", str(a.session), "--config", config.name, "--loop", "--headless", "--speed", "max", "--listen", f"127.0.0.1:{port}", *more]
    process = subprocess.Popen(command)
    try:
        samples = sample(process, port, a.frames, a.every)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
    grown = growth_mb(samples, a.frames)
    flat = grown <= a.allow_mb
    print(f"soak: {samples[-1][0]} frames, {samples[-1][1]:.1f} MB at the end, grown by {grown:+.1f} MB of {a.allow_mb:g} allowed: {'flat' if flat else 'NOT flat'}")
    return 0 if flat else 1


if __name__ == "__main__":
    sys.exit(main())

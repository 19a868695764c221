#!/usr/bin/env python3
"""Let a thousand browsers watch the live picture, a hundred of which do not read, and compare the frame time: `make viewers`.

    tests/judge/viewers.py --penumbra target/release/penumbra [--viewers 1000] [--stalled 100] [--pairs 7] [--seconds 15] [--write]

The bundled session is replayed in a loop, with no viewers and with all of them in turns; the viewers are one process on this
machine that discards what it receives, at the lowest priority. Linux only. Exit status: 0, 1 if a figure is not reached, 2 if
the run failed.
"""
from __future__ import annotations

import argparse
import datetime
import json
import os
import re
import resource
import selectors
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from dataclasses import dataclass
from pathlib import Path

from python_env import ROOT
from tables import RESULTS, write_between

SESSION = ROOT / "tests/fixtures/sessions/desk.mcap"
#: The figures to reach: frame time with viewers against without, growth of memory in MB, seconds until a stalled viewer is let go.
MAX_RATIO, MAX_GROWTH_MB, MAX_STALL_S = 1.05, 300, 120
#: With a longer pause of this script, seconds, a measurement is repeated, so many times at most.
MAX_PAUSE_S, MAX_TRIES = 1.5, 20
#: Threads that serve viewers; all others compose or prepare frames.
SERVING = ("service", "tokio")


class Failed(Exception):
    """The run failed."""


class Rig:
    """A replay in a loop, and what it reports."""

    def __init__(self, penumbra: str, viewers: int, folder: Path) -> None:
        config = folder / "viewers.toml"
        config.write_text(f"[replay]\nloop = true\n[status]\nviewers = {viewers}\n[shadows]\nrefresh_per_frame = 8\n[output]\nwindow = false\n")
        command = [penumbra, "replay", str(SESSION), "--config", str(config), "--headless", "--listen", "127.0.0.1:0"]
        self.log = (folder / "replay.log").open("w+")
        self.process = subprocess.Popen(command, stdout=self.log, stderr=subprocess.STDOUT)
        self.port = self._port()

    def _port(self) -> int:
        for _ in range(600):
            self.log.seek(0)
            found = re.search(r"http://127\.0\.0\.1:(\d+)/", self.log.read())
            if found:
                return int(found[1])
            if self.process.poll() is not None:
                break
            time.sleep(0.1)
        self.log.seek(0)
        raise Failed(f"the replay does not start: {self.log.read()[-500:]}")

    def get(self, path: str) -> str:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=30) as answer:
            return answer.read().decode()

    def status(self) -> dict:
        return json.loads(self.get("/status"))

    def frames(self) -> tuple[float, int]:
        """Sum of the frame times so far in seconds, and number of the frames."""
        text = self.get("/metrics")
        found = [re.search(rf'penumbra_stage_seconds_{what}{{stage="total",processor="cpu"}} (\S+)', text) for what in ("sum", "count")]
        return (float(found[0][1]), int(found[1][1])) if all(found) else (0.0, 0)

    def warm_up(self, frames: int) -> None:
        """Waits until it has composed so many frames."""
        for _ in range(600):
            if self.frames()[1] >= frames:
                return
            time.sleep(0.5)
        raise Failed("the replay composes no frames")

    def processor_time(self) -> tuple[float, float]:
        """Seconds on the processor so far: threads of frames, threads that serve viewers."""
        frames = serving = 0.0
        for task in Path(f"/proc/{self.process.pid}/task").iterdir():
            try:
                name, spent = (task / "comm").read_text(), int((task / "schedstat").read_text().split()[0]) * 1e-9
            except FileNotFoundError:  # it has ended
                continue
            if name.startswith(SERVING):
                serving += spent
            else:
                frames += spent
        return frames, serving

    def resident_mb(self) -> float:
        return self.status()["program"]["memory"]["resident_bytes"] / 1e6

    def stop(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(60)
        except subprocess.TimeoutExpired:
            self.process.kill()


def kernel_socket_mb() -> float:
    """Memory of all TCP sockets of this machine in the kernel."""
    pages = re.search(r"^TCP: .* mem (\d+)", Path("/proc/net/sockstat").read_text(), re.MULTILINE)
    return int(pages[1]) * os.sysconf("SC_PAGESIZE") / 1e6 if pages else 0.0


class Viewers:
    """Viewers of the stream: some read, some do not."""

    def __init__(self, port: int, reading: int, stalled: int) -> None:
        self.selector = selectors.EpollSelector()
        self.received: dict[socket.socket, int] = {}
        self.stalled = [self._open(port, True) for _ in range(stalled)]
        for _ in range(reading):
            viewer = self._open(port, False)
            viewer.setblocking(False)
            self.received[viewer] = 0
            self.selector.register(viewer, selectors.EVENT_READ)

    @staticmethod
    def _open(port: int, is_stalled: bool) -> socket.socket:
        viewer = socket.socket()
        if is_stalled:
            viewer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        viewer.connect(("127.0.0.1", port))
        viewer.sendall(b"GET /stream.mjpeg HTTP/1.1\r\nHost: localhost\r\n\r\n")
        return viewer

    def read(self, seconds: float) -> bool:
        """Discards for a time what arrives, in the kernel: without copying it. Whether this machine ran all the time."""
        until, is_steady, last = time.monotonic() + seconds, True, time.monotonic()
        while (left := until - time.monotonic()) > 0:
            ready = self.selector.select(min(left, 0.2))
            is_steady, last = is_steady and time.monotonic() - last < MAX_PAUSE_S, time.monotonic()
            for key, _ in ready:
                try:
                    count = key.fileobj.recv_into(SCRAP, len(SCRAP), socket.MSG_TRUNC)
                except BlockingIOError:
                    continue
                except ConnectionError:
                    count = 0
                if not count:
                    raise Failed("a viewer that reads was let go")
                self.received[key.fileobj] += count
        return is_steady

    def close(self) -> None:
        for viewer in [*self.received, *self.stalled]:
            viewer.close()
        self.selector.close()


SCRAP = bytearray(1 << 20)


def idle(seconds: float) -> bool:
    """Waits; whether this machine ran all the time."""
    return all([pause(0.2) < MAX_PAUSE_S for _ in range(round(seconds / 0.2))])


def pause(seconds: float) -> float:
    began = time.monotonic()
    time.sleep(seconds)
    return time.monotonic() - began


@dataclass
class Window:
    """What was measured in a time: milliseconds a frame, frames per second, processor time a frame and of others."""

    frame_ms: float
    per_second: float
    frame_cpu_ms: float
    serving_cpu: float
    load_cpu: float
    resident_mb: float
    kernel_mb: float
    pictures: float


def measure(rig: Rig, viewers: Viewers | None, seconds: float) -> Window:
    """Measures for a time; `viewers` read meanwhile. Again if this machine was suspended or stood still."""
    for _ in range(MAX_TRIES):
        window, is_steady = measure_once(rig, viewers, seconds)
        if is_steady:
            return window
    raise Failed("this machine is too busy")


def measure_once(rig: Rig, viewers: Viewers | None, seconds: float) -> tuple[Window, bool]:
    before, cpu, load, began = rig.frames(), rig.processor_time(), time.process_time(), time.monotonic()
    encoded = rig.status()["stream"]["encoded"]
    is_steady = viewers.read(seconds) if viewers else idle(seconds)
    wall, load = time.monotonic() - began, time.process_time() - load
    after, cpu_after = rig.frames(), rig.processor_time()
    frames = max(after[1] - before[1], 1)
    window = Window(
        1000 * (after[0] - before[0]) / frames, frames / wall, 1000 * (cpu_after[0] - cpu[0]) / frames, (cpu_after[1] - cpu[1]) / wall, load / wall,
        rig.resident_mb(), kernel_socket_mb(), (rig.status()["stream"]["encoded"] - encoded) / wall)
    return window, is_steady


def until_let_go(rig: Rig, viewers: Viewers, reading: int) -> float:
    """Seconds until the status counts only the viewers that read."""
    began = time.monotonic()
    while rig.status()["stream"]["viewers"] > reading:
        if time.monotonic() - began > 2 * MAX_STALL_S:
            raise Failed("stalled viewers are not let go")
        viewers.read(1.0)
    return time.monotonic() - began


def run(rig: Rig, a: argparse.Namespace) -> dict:
    """Measures all pairs, then how long stalled viewers stay."""
    reading, pairs, fewest = a.viewers - a.stalled, [], []
    rig.warm_up(a.warm_up)
    idle_mb, base = rig.resident_mb(), measure(rig, None, a.seconds)
    for _ in range(a.pairs):
        viewers = Viewers(rig.port, reading, a.stalled)
        viewers.read(4.0)
        if rig.status()["stream"]["viewers"] != a.viewers:
            raise Failed(f"{rig.status()['stream']['viewers']} of {a.viewers} viewers are served")
        watched = measure(rig, viewers, a.seconds)
        fewest.append(min(viewers.received.values()))
        viewers.close()
        time.sleep(3)
        after = measure(rig, None, a.seconds)
        pairs.append((base, watched, after))
        print(f"frame {base.frame_ms:.1f} {watched.frame_ms:.1f} {after.frame_ms:.1f} ms, {watched.pictures:.1f} pictures/s to each, "
              f"serving {watched.serving_cpu:.1%}, viewers themselves {watched.load_cpu:.1%} of a processor", flush=True)
        base = after
    viewers = Viewers(rig.port, reading, a.stalled)
    stall = until_let_go(rig, viewers, reading)
    viewers.close()
    return {"pairs": pairs, "idle_mb": idle_mb, "stall_s": stall, "fewest_bytes": min(fewest)}


def ratios(pairs: list, what: str) -> list[float]:
    """With viewers against the mean of before and after, sorted."""
    return sorted(getattr(w, what) / ((getattr(b, what) + getattr(a, what)) / 2) for b, w, a in pairs)


def report(results: dict, a: argparse.Namespace) -> tuple[str, list[str]]:
    """The table, and the figures that were not reached."""
    pairs = results["pairs"]
    watched = [w for _, w, _ in pairs]
    mean = lambda what, of=watched: statistics.fmean(getattr(w, what) for w in of)  # noqa: E731
    unwatched = [w for b, _, after in pairs for w in (b, after)]
    growth = max(w.resident_mb for w in watched) - min(w.resident_mb for w in unwatched)
    rows = [(name, *(f"{x:.3f}" for x in (statistics.median(r), r[0], r[-1]))) for name, r in
            (("time of a frame", ratios(pairs, "frame_ms")), ("processor time of a frame", ratios(pairs, "frame_cpu_ms")),
             ("frames per second", ratios(pairs, "per_second")))]
    lines = [
        f"{datetime.date.today()}, {os.cpu_count()} processors, software driver; {a.viewers} viewers, {a.stalled} of them stalled; {len(pairs)} pairs of {a.seconds:.0f} s.",
        f"Without viewers: {mean('frame_ms', unwatched):.1f} ms a frame, {mean('per_second', unwatched):.1f} frames per second.", "",
        "| with viewers against without | median | least | most |", "|---|---|---|---|",
        *("| " + " | ".join(row) + " |" for row in rows), "",
        "| with viewers | |", "|---|---|",
        f"| pictures per second to each viewer | {mean('pictures'):.1f} |",
        f"| processor time of the threads that serve them | {mean('serving_cpu'):.1%} of one |",
        f"| processor time of the viewers themselves, on the same machine | {mean('load_cpu'):.1%} of one |",
        f"| memory of the program, most, and growth against without | {max(w.resident_mb for w in watched):.0f} MB, {growth:.0f} MB |",
        f"| memory of TCP in the kernel, both ends, most | {max(w.kernel_mb for w in watched):.0f} MB |",
        f"| fewest bytes that a viewer who reads received in {a.seconds + 4:.0f} s | {results['fewest_bytes']:,} |",
        f"| stalled viewers are let go after | {results['stall_s']:.0f} s |",
    ]
    ratio = statistics.median(ratios(pairs, "frame_ms"))
    missed = [text for text, is_missed in (
        (f"frame time {ratio:.3f}, allowed {MAX_RATIO}", ratio > MAX_RATIO),
        (f"memory grows by {growth:.0f} MB, allowed {MAX_GROWTH_MB}", growth > MAX_GROWTH_MB),
        (f"stalled viewers stay {results['stall_s']:.0f} s, allowed {MAX_STALL_S}", results["stall_s"] > MAX_STALL_S),
        ("a viewer received no complete picture", results["fewest_bytes"] < 20_000)) if is_missed]
    return "\n".join(lines), missed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--penumbra", required=True)
    parser.add_argument("--viewers", type=int, default=1000)
    parser.add_argument("--stalled", type=int, default=100)
    parser.add_argument("--pairs", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=15)
    parser.add_argument("--warm-up", type=int, default=200, help="frames before the first measurement (default: %(default)s)")
    parser.add_argument("--write", action="store_true", help="put the table into docs/src/results/unattended.md")
    a = parser.parse_args()
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    with tempfile.TemporaryDirectory() as folder:
        try:
            rig = Rig(a.penumbra, a.viewers, Path(folder))
        except Failed as error:
            print(f"viewers: {error}", file=sys.stderr)
            return 2
        # After the program has started, which would inherit it.
        os.nice(19)
        try:
            text, missed = report(run(rig, a), a)
        except (Failed, OSError) as error:
            print(f"viewers: {error}", file=sys.stderr)
            return 2
        finally:
            rig.stop()
    print(text)
    if a.write:
        write_between(RESULTS / "unattended.md", "viewers", text)
    for what in missed:
        print(f"MISSED {what}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

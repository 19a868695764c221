#!/usr/bin/env python3
"""Measure everything that is to be measured on a graphics adapter and write one report.

    tests/judge/gpu_check.py [--adapter NAME] [--short]

The report (Markdown, target/gpu-check/report.md) has the adapter, all cases of the benchmark, the
case of 1920×1080 pixels with 64 lights that are all redrawn, the latency of a live rig, the tests on
that adapter, and the fidelity of the live picture. A step that fails is reported, and the others still run.

Exit status: 0 everything ran and, on a GPU, the bar is reached; 1 otherwise; 2 nothing could run.
"""
from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bench_table
from python_env import ROOT, TARGET
from rigs import FOLDERS

#: Milliseconds on the GPU of a picture of 1920×1080 pixels with 64 lights, all redrawn.
MAX_MS, AIM_MS = 1.0, 0.5
#: Seconds from the loss of the device to the next picture.
MAX_RECOVERY_S = 2.0
#: Tests that use the adapter that PENUMBRA_TEST_ADAPTER names.
TESTS = ["-p", "penumbra", "-p", "penumbra-compositor", "--lib", "--test", "compositor", "--test", "faulty_rig", "--test", "graphics_device"]


class Missed(Exception):
    """A figure misses its bar, or a step failed; the text goes into the report."""


@dataclass
class Step:
    """A section of the report: a command and what is made of its output, kept in `log`."""
    title: str
    command: list[str]
    section: Callable[[str], str]

    def run(self, log: Path, environment: dict[str, str]) -> tuple[str, bool]:
        """The section's text, and whether it succeeded."""
        began = time.monotonic()
        done = subprocess.run(self.command, cwd=ROOT, env={**os.environ, **environment}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              text=True, check=False)
        log.write_text(f"$ {shlex.join(self.command)}\n{done.stdout}")
        good = done.returncode == 0
        try:
            text = self.section(done.stdout)
        except Missed as missed:
            text, good = str(missed), False
        except (OSError, KeyError, ValueError):
            text = ""
        if not good:
            lines = [line for line in done.stdout.splitlines() if line.strip()] or ["no output"]
            text = f"{text}\n\n**Not passed** (exit status {done.returncode}): `{lines[-1].strip()}`"
        return f"## {self.title}\n\n{text.strip()}\n\n{time.monotonic() - began:.0f} s\n", good


def verbatim(output: str) -> str:
    """The output as it is."""
    return f"```text\n{output.strip()}\n```"


def tests_section(output: str) -> str:
    """Sums of passed and failed tests, and the names of the failed ones."""
    sums = [line.strip() for line in output.splitlines() if line.startswith("test result:")]
    failed = sorted({line.split()[1] for line in output.splitlines() if line.startswith("test ") and line.endswith("FAILED")})
    return "\n".join([f"- {line}" for line in sums] + [f"- failed: `{name}`" for name in failed])


def bench_section(report: Path) -> Callable[[str], str]:
    """The benchmark's table."""
    return lambda _: bench_table.table([report])


def big_section(report: Path) -> Callable[[str], str]:
    """The bar of the large picture; on a software driver it is only stated."""
    def section(_: str) -> str:
        found = json.loads(report.read_text())
        row = next(r for r in found["rows"] if r["lights"] == r["refreshed_per_frame"] == 64)
        timed = any(p["ms"] > 0 for p in row["passes"])
        ms, clock = (row["gpu_ms"], "on the device") if timed else (row["wall_ms"], "of wall time, because the adapter has no time stamps")
        text = f"{bench_table.table([report])}\n\n64 lights, all redrawn: median {ms['p50']:.2f} ms {clock}"
        if found["software"]:
            return text + "; a software driver has no bar."
        if ms["p50"] > MAX_MS:
            raise Missed(f"{text}; allowed {MAX_MS} ms.")
        return text + f"; allowed {MAX_MS} ms, aim {AIM_MS} ms."
    return section


def live_section(report: Path) -> Callable[[str], str]:
    """The latency of live pictures."""
    def section(_: str) -> str:
        lines = ["| size | lights | samples | frames/s | arrival to picture, ms p50 | p99 | compose, ms p50 | p99 |", "|---" * 8 + "|"]
        found = json.loads(report.read_text())
        for r in found["live"]:
            cells = [f"{r['width']}×{r['height']}", r["lights"], r["samples"], f"{r['frames_per_second']:.1f}"]
            cells += [f"{r[kind][q]:.2f}" for kind in ("arrival_to_picture_ms", "total_ms") for q in ("p50", "p99")]
            lines.append("| " + " | ".join(map(str, cells)) + " |")
        seconds = found["recovery_seconds"]
        text = "\n".join([*lines, "", f"After the loss of the device the next picture came in {seconds:.2f} s; allowed {MAX_RECOVERY_S:g} s."])
        if seconds > MAX_RECOVERY_S and not found["software"]:
            raise Missed(text)
        return text
    return section


def steps(a: argparse.Namespace) -> list[Step]:
    """All steps, or those of the short form, which takes seconds."""
    program, adapter = str(a.penumbra.resolve()), ["--adapter", a.adapter] if a.adapter else []
    frames = ["--frames", "2"] if a.short else []
    # The time-out of a live rig grows with the number of pictures.
    live_frames = ["--frames", "12"] if a.short else []

    def bench(case: str, report: Path, *arguments: str) -> list[str]:
        counts = live_frames if case == "live" else frames
        return [program, "bench", "--case", case, "--json", str(report), "--force", *adapter, *counts, *arguments]
    found = [Step("Adapter", [program, "doctor", *adapter], verbatim)]
    for case in ["supan"] if a.short else ["supan", "kakuta2007", "kakuta2004", "lightprobe"]:
        report = a.out / f"{case}.json"
        found.append(Step(f"Benchmark {case}", bench(case, report), bench_section(report)))
    big = a.out / "big.json"
    found.append(Step("1920×1080", bench("supan", big, "--size", "1920x1080"), big_section(big)))
    for size in ["640x480"] if a.short else ["640x480", "1280x720"]:
        live = a.out / f"live-{size}.json"
        found.append(Step(f"Latency of a live rig, {size}", bench("live", live, "--size", size), live_section(live)))
    if not a.short:
        found.append(Step("Tests", ["cargo", "test", "--release", "--locked", "--no-fail-fast", *TESTS], tests_section))
        command = [sys.executable, str(Path(__file__).with_name("fidelity.py")), "--quality", "live", "--penumbra", program, "--truth", *map(str, a.truth),
                   "--out", str(a.out / "fidelity"), *(["--extra", shlex.join(adapter)] if adapter else [])]
        found.append(Step("Fidelity of the live picture", command, lambda _: (a.out / "fidelity/table.md").read_text()))
    return found


def adapter_name(a: argparse.Namespace) -> str:
    """The adapter that the benchmark has chosen, for the tests, which otherwise use the software driver."""
    report = a.out / "supan.json"
    return a.adapter or (json.loads(report.read_text())["adapter"] if report.exists() else "llvmpipe")


def check(a: argparse.Namespace, wanted: list[Step]) -> bool:
    """Runs the steps, writes the report after each, and returns whether all succeeded."""
    a.out.mkdir(parents=True, exist_ok=True)
    for old in a.out.glob("*.json"):
        old.unlink()
    commit = subprocess.run(["git", "-C", str(ROOT), "describe", "--always", "--dirty"], capture_output=True, text=True, check=False).stdout.strip()
    sections, good = [f"# Graphics check\n\nRevision {commit or 'unknown'}, {time.strftime('%Y-%m-%d')}, {os.cpu_count()} processors."], True
    for number, step in enumerate(wanted):
        print(f"gpu_check: {step.title}", file=sys.stderr)
        text, passed = step.run(a.out / f"{number:02}.log", {"PENUMBRA_TEST_ADAPTER": adapter_name(a)})
        sections.append(text)
        good &= passed
        (a.out / "report.md").write_text("\n\n".join(sections) + "\n")
    return good


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--adapter", help="part of the adapter's name; the fastest adapter without it. The tests use it, too")
    parser.add_argument("--short", action="store_true", help="two frames each, without the tests and the fidelity")
    parser.add_argument("--penumbra", type=Path, default=TARGET / "release/penumbra", help="the program; default: %(default)s")
    parser.add_argument("--truth", type=Path, nargs="+", default=FOLDERS, help="folders of more rigs with truth")
    parser.add_argument("--out", type=Path, default=TARGET / "gpu-check", help="report, logs; default: %(default)s")
    a = parser.parse_args()
    a.out = a.out.resolve()
    return a


def main() -> int:
    a = options()
    if not a.penumbra.exists():
        print(f"gpu_check: {a.penumbra} is missing; run `make build`", file=sys.stderr)
        return 2
    good = check(a, steps(a))
    print(a.out / "report.md")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

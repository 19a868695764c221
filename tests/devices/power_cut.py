#!/usr/bin/env python3
"""Cut the power of a rig that records, and read what is left: `make power-cut`.

    tests/devices/power_cut.py [--seconds 20] [--cuts 100] [--slow N] [--write]

A guest records its cameras and its tracker on an ext4 file system; QEMU logs every write and flush of the disk and is
killed. A second guest mounts the disk as the cut left it. From the log follow the disks that cuts at other instants would have
left, with none or with some of the writes after the last flush; their journal is replayed by e2fsck. In each, every message
that had arrived a second before the cut must be there. The disk is as fast as the host's memory; with --slow there is a second
one, for which the guest's clock is this machine's, as QEMU's limits are: the machine must be quiet. Needs the packages of
`make test-devices` and e2fsprogs.

Exit status: 0, 1 if a cut loses more than a second or leaves an unreadable session, 2 if the run failed.
"""
from __future__ import annotations

import argparse
import datetime
import json
import os
import random
import struct
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "tests/judge"))

from disk_log import FLUSH, Disk, DiskLog  # noqa: E402
from python_env import Unavailable, run_with  # noqa: E402
from tables import RESULTS, write_between  # noqa: E402

VM = ROOT / "target/vm"
LOGS, WORK = VM / "logs", VM / "power"
#: The disk after a cut, hundreds of times: in memory where that is possible.
CUT_IMAGE = (Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else WORK) / f"penumbra-cut-{os.getpid()}.img"
TOOLS_PATH = os.environ["PATH"] + ":/usr/sbin:/sbin"
#: Sizes of the disk and of its file system, MiB, as in tests/devices/inside/tests/program/power.rs.
DISK_MIB, FILE_SYSTEM_MIB = 128, 126
CLOCK_AT = 127 << 20
#: How long a guest may run, seconds of this machine, which may be busy.
PATIENCE = 7200
#: What a cut may lose, seconds.
ALLOWED = 1.0
#: If the guest's clock pauses for longer, the guest as a whole stood still, and what it records has a gap; seconds.
MAX_PAUSE, AFTER_PAUSE = 0.7, 2


class Failed(Exception):
    """The run failed."""


def run(*command: str | Path, allowed: tuple[int, ...] = (0,)) -> str:
    """Runs a command; returns its output."""
    done = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT, env={**os.environ, "PATH": TOOLS_PATH})
    if done.returncode not in allowed:
        raise Failed(f"{command[0]}: {done.stdout.strip().splitlines()[-1:] or done.returncode}")
    return done.stdout


def pack(list_name: str) -> Path:
    """Packs a guest with one list of tests; returns its initramfs."""
    run("tests/devices/initramfs", list_name)
    packed = WORK / f"{list_name}.initramfs"
    (VM / "initramfs").rename(packed)
    return packed


def boot(initramfs: Path, disk: list[str], seconds: int, counts_time: bool = True) -> subprocess.Popen:
    """Starts a guest with QEMU's arguments for its disks. `counts_time`: whether its clock is independent of this machine's."""
    environment = {**os.environ, "INITRAMFS": str(initramfs), "COUNTED_TIME": str(int(counts_time))}
    command = ["tests/devices/boot", str(seconds), *disk]
    console = (LOGS / f"{initramfs.stem}.log").open("w")
    return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=console, stderr=subprocess.STDOUT, process_group=0)


def record_and_cut(seconds: float, per_second: float | None) -> None:
    """Lets a guest record for some seconds, then kills it as a power cut would end it. `per_second`: how many writes its
    disk completes."""
    enough = LOGS / "enough"
    enough.unlink(missing_ok=True)
    (LOGS / "record-seconds").write_text(f"{seconds}")
    # Without `no-flush` the host's disk would be waited for; the host goes on, so its memory suffices.
    base = f"driver=raw,node-name=base,file.driver=file,file.filename={WORK}/disk.img,cache.no-flush=on,file.cache.no-flush=on"
    log = f"driver=raw,node-name=log,file.driver=file,file.filename={WORK}/disk.log,cache.no-flush=on,file.cache.no-flush=on"
    both = ["-blockdev", base, "-blockdev", log, "-blockdev", "driver=blklogwrites,node-name=both,file=base,log=log,log-sector-size=512"]
    # The clock has a disk of its own, so that it does not wait, and takes nothing from what is recorded.
    clock = ["-blockdev", f"driver=raw,node-name=clock,file=both,offset={CLOCK_AT},size=4096"]
    disk = ["-blockdev", "driver=raw,node-name=disk,file=both"]
    if per_second is not None:
        disk = ["-object", f"throttle-group,id=slow,x-iops-write={per_second:g}", "-blockdev", "driver=throttle,node-name=disk,throttle-group=slow,file=both"]
    devices = [f"virtio-blk-pci,drive={name},share-rw=on" for name in ("disk", "clock")]
    guest = boot(pack("power-record"), [*both, *disk, *clock, "-device", devices[0], "-device", devices[1]], PATIENCE, per_second is None)
    try:
        while not enough.exists():
            if guest.poll() is not None:
                raise Failed(f"the guest ended before the power was cut; see {LOGS}")
            time.sleep(0.1)
    finally:
        if guest.poll() is None:
            os.killpg(guest.pid, 9)
        guest.wait()


@dataclass(frozen=True)
class Message:
    """A message of a session."""

    topic: str
    arrived: int
    sequence: int
    size: int


def messages(session: Path) -> set[Message]:
    """The messages of a session up to its end or its first defect, read without Penumbra's code."""
    from mcap.exceptions import McapError
    from mcap.records import Channel, Message as Record
    from mcap.stream_reader import StreamReader

    found, topics = set(), {}
    with session.open("rb") as file:
        try:
            for record in StreamReader(file, validate_crcs=True, record_size_limit=None).records:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Record):
                    found.add(Message(topics[record.channel_id], record.log_time, record.sequence, len(record.data)))
        except (McapError, EOFError, struct.error, ValueError):
            pass
    return found


def take_session(disk: bytes, to: Path) -> bool:
    """Replays the journal of a disk's file system and copies the session out of it; whether there is one."""
    to.unlink(missing_ok=True)
    try:
        CUT_IMAGE.write_bytes(disk[: FILE_SYSTEM_MIB << 20])
        # Status 1: it replayed something.
        run("e2fsck", "-fy", "-E", "journal_only", CUT_IMAGE, allowed=(0, 1))
        run("debugfs", "-R", f"dump /session.mcap {to}", CUT_IMAGE)
    finally:
        CUT_IMAGE.unlink(missing_ok=True)
    return to.exists()


@dataclass
class Cut:
    """What a cut left: age of the oldest message that is lost, and whether the program reads the session."""

    lost: float
    is_readable: bool


def judge(session: Path, at: int, reference: set[Message], penumbra: str) -> Cut:
    """Compares what a cut at the clock time `at` left with all that was recorded."""
    read = subprocess.run([penumbra, "info", str(session), "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    missing = (m.arrived for m in reference - messages(session) if m.arrived <= at)
    return Cut((at - min(missing, default=at)) * 1e-9, read.returncode == 0)


def clock_entries(log: DiskLog) -> list[tuple[int, int]]:
    """The entries with the guest's clock: number, nanoseconds."""
    return [(n, struct.unpack("<Q", log.data(e)[:8])[0]) for n, e in enumerate(log.entries) if e.at == CLOCK_AT and e.size]


def judge_cuts(log: DiskLog, count: int, penumbra: str) -> dict[str, list[Cut]]:
    """Judges cuts in even intervals. The clock was read before its write reached the log, so the next one is the cut's time."""
    whole, cut = WORK / "whole.mcap", WORK / "cut.mcap"
    everything = Disk(log, WORK / "empty.img")
    everything.play(len(log.entries))
    if not take_session(everything.everything(), whole):
        raise Failed("nothing was recorded")
    reference = messages(whole)
    first = min(m.arrived for m in reference) + 2_000_000_000
    last = max(m.arrived for m in reference)
    clock = clock_entries(log)
    clock = [(a[0], b[1]) for a, b in zip(clock, clock[1:])]
    still = [b[1] for a, b in zip(clock, clock[1:]) if b[1] - a[1] > MAX_PAUSE * 1e9]
    if still:
        print(f"this machine is busy: the guest stood still {len(still)} times; cuts within {AFTER_PAUSE} s after that are left out")
    usable = [(n, at) for n, at in clock if first <= at <= last and not any(0 <= at - end < AFTER_PAUSE * 1e9 for end in still)]
    if len(usable) < count:
        raise Failed(f"the guest wrote its clock only {len(usable)} times")
    chosen = [usable[i * len(usable) // count] for i in range(count)]
    disk, chance = Disk(log, WORK / "empty.img"), random.Random(1)
    cuts: dict[str, list[Cut]] = {"none of them": [], "a random half of them": []}
    for number, at in chosen:
        disk.play(number + 1)
        for kind, left in zip(cuts, (disk.left(None), disk.left(chance))):
            there = take_session(left, cut)
            cuts[kind].append(judge(cut, at, reference, penumbra) if there else Cut((at - first) * 1e-9, False))
    print(f"{len(reference)} messages in {(last - first) * 1e-9 + 2:.1f} s; {sum(e.flags & FLUSH for e in log.entries)} flushes among {len(log.entries)} requests to the disk", flush=True)
    return cuts


def judge_reboot(log: DiskLog, penumbra: str) -> Cut:
    """Lets a second guest mount what the kill left, and judges its copy of the session."""
    disk = Disk(log, WORK / "empty.img")
    disk.play(len(log.entries))
    (WORK / "left.img").write_bytes(disk.left(None))
    left = LOGS / "left.mcap"
    left.unlink(missing_ok=True)
    guest = boot(pack("power-read"), ["-drive", f"if=virtio,format=raw,file={WORK}/left.img"], PATIENCE)
    guest.wait()
    if "guest: passed 1 failed 0" not in (LOGS / "power-read.log").read_text(errors="replace") or not left.exists():
        raise Failed(f"the second guest could not read the session; see {LOGS}")
    # What the recorder still had in memory is on no disk, so all since the newest message counts as lost.
    newest = max((m.arrived for m in messages(left)), default=0)
    return Cut((clock_entries(log)[-1][1] - newest) * 1e-9, judge(left, newest, set(), penumbra).is_readable)


@dataclass
class Result:
    """What all cuts of one disk left: those computed from the log, by the writes that reached it; and the guest's own."""

    cuts: dict[str, list[Cut]]
    reboot: Cut
    flushes_per_second: float

    def rows(self) -> list[tuple[str, str, list[Cut]]]:
        computed = [("computed from the log", kind, of) for kind, of in self.cuts.items()]
        return [*computed, ("guest killed, disk mounted by a second guest", "none of them", [self.reboot])]


def table(results: dict[str, Result]) -> str:
    """The table of the documentation."""
    lines = [f"{datetime.date.today()}:", "", "| disk | flushes per second | cut | unflushed writes that reach the disk | cuts | readable | lost, s: median | largest |", "|---|---|---|---|---|---|---|---|"]
    for disk, result in results.items():
        for what, kind, of in result.rows():
            lost = sorted(c.lost for c in of)
            lines.append(f"| {disk} | {result.flushes_per_second:.1f} | {what} | {kind} | {len(of)} | {sum(c.is_readable for c in of)} | {lost[len(lost) // 2]:.2f} | {lost[-1]:.2f} |")
    return "\n".join(lines)


def judge_disk(a: argparse.Namespace, per_second: float | None, penumbra: str) -> Result:
    """Records onto a disk, and judges all cuts."""
    make_disk()
    record_and_cut(a.seconds, per_second)
    log = DiskLog(WORK / "disk.log")
    clock = clock_entries(log)
    seconds = (clock[-1][1] - clock[0][1]) * 1e-9
    flushes = sum(e.flags & FLUSH for e in log.entries[clock[0][0] :])
    return Result(judge_cuts(log, a.cuts, penumbra), judge_reboot(log, penumbra), flushes / seconds)


def skip(why: str) -> int:
    print(f"SKIPPED power-cut: {why}")
    return 2 if os.environ.get("PENUMBRA_DEVICES_REQUIRED") == "1" else 0


def make_disk() -> None:
    """Makes the guest's disk and its empty log."""
    for name, mib in (("disk.img", DISK_MIB), ("disk.log", 4096)):
        (WORK / name).unlink(missing_ok=True)
        with (WORK / name).open("wb") as file:
            file.truncate(mib << 20)
    run("mkfs.ext4", "-q", WORK / "disk.img", f"{FILE_SYSTEM_MIB}M")
    (WORK / "empty.img").write_bytes((WORK / "disk.img").read_bytes())


def prepare() -> str:
    """Fetches and builds what the guests need; returns the program's path. Exits where that is impossible."""
    for folder in (LOGS, WORK):
        folder.mkdir(parents=True, exist_ok=True)
    for command in ([ROOT / ".ci/packages", "devices"], [ROOT / "tests/devices/fetch"]):
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT)
        if done.returncode:
            sys.exit(skip((done.stdout.strip().splitlines() or ["no packages"])[-1]))
    if subprocess.run(["sh", "-c", "command -v mkfs.ext4 e2fsck debugfs"], stdout=subprocess.DEVNULL, env={**os.environ, "PATH": TOOLS_PATH}).returncode:
        sys.exit(skip("e2fsprogs is missing (apt-get install e2fsprogs)"))
    programs = run(sys.executable, "tests/devices/build.py", "power-record", "power-read")
    (VM / "programs").write_text("".join(line + "\n" for line in programs.splitlines() if line.split(" ")[0] in ("bin", "tests")))
    return next(line.split(" ")[2] for line in programs.splitlines() if line.startswith("bin penumbra "))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20, help="how long the guest records, by its own clock (default: %(default)s)")
    parser.add_argument("--cuts", type=int, default=100, help="instants of computed cuts (default: %(default)s)")
    parser.add_argument("--slow", type=float, metavar="N", help="writes per second of a second, slow disk")
    parser.add_argument("--write", action="store_true", help="put the table into docs/src/results/unattended.md")
    a = parser.parse_args()
    try:
        run_with(["mcap", "lz4", "zstandard"], ROOT / "tests/judge/requirements-mcap.txt")
        penumbra = prepare()
        results = {"fast": judge_disk(a, None, penumbra)}
        if a.slow:
            results[f"{a.slow:g} writes per second"] = judge_disk(a, a.slow, penumbra)
    except Unavailable as error:
        return skip(str(error))
    except Failed as error:
        print(f"power-cut: {error}", file=sys.stderr)
        return 2
    text = table(results)
    print(text)
    if a.write:
        write_between(RESULTS / "unattended.md", "power-cut", text)
    judged = [cut for result in results.values() for _, _, of in result.rows() for cut in of]
    bad = [cut for cut in judged if cut.lost > ALLOWED or not cut.is_readable]
    for cut in bad[:5]:
        print(f"MISSED: {cut.lost:.2f} s lost{'' if cut.is_readable else ', unreadable'}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

"""The writes of a disk in their order, as QEMU's driver blklogwrites logs them, and what a power cut leaves of them.

Format: Documentation/admin-guide/device-mapper/log-writes.rst of the kernel, drivers/md/dm-log-writes.c.
"""
from __future__ import annotations

import random
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Iterator

MAGIC = 0x6A736677736872
FLUSH, FUA, DISCARD = 1, 2, 4


@dataclass(frozen=True)
class Entry:
    """One request to the disk: `at` and `size` in bytes, and where its data are in the log."""

    at: int
    size: int
    flags: int
    data_at: int


class DiskLog:
    """The log of a disk. A flush makes all writes before it durable; FUA its own."""

    def __init__(self, path: Path) -> None:
        self.file = path.open("rb")
        magic, version, _, self.sector = struct.unpack("<QQQI", self.file.read(28))
        if magic != MAGIC or version != 1:
            raise ValueError(f"{path}: not a log of a disk's writes")
        # The count in the header is written now and then only, so it is not used.
        self.entries = list(self._read())

    def _read(self) -> Iterator[Entry]:
        at = self.sector
        while True:
            self.file.seek(at)
            head = self.file.read(32)
            if len(head) < 32:
                return
            sector, sectors, flags, _ = struct.unpack("<QQQQ", head)
            # Not written: the disk had not been told to write it, or was cut off at it.
            if flags == 0 and sectors == 0:
                return
            at += self.sector
            yield Entry(sector * self.sector, sectors * self.sector, flags, at)
            at += 0 if flags & DISCARD else sectors * self.sector

    def data(self, entry: Entry) -> bytes:
        self.file.seek(entry.data_at)
        return self.file.read(entry.size)


class Disk:
    """A disk that plays its log from an image."""

    def __init__(self, log: DiskLog, image: Path) -> None:
        self.log = log
        self.durable = bytearray(image.read_bytes())
        self.next = 0
        #: Writes since the last flush.
        self.pending: list[Entry] = []

    def play(self, end: int) -> None:
        """Plays the log before entry number `end`."""
        for entry in self.log.entries[self.next : end]:
            if entry.flags & FLUSH:
                for write in self.pending:
                    self._write(self.durable, write)
                self.pending = []
            if entry.size and not entry.flags & DISCARD:
                if entry.flags & FUA:
                    self._write(self.durable, entry)
                else:
                    self.pending.append(entry)
        self.next = max(self.next, end)

    def left(self, chance: random.Random | None) -> bytes:
        """What a power cut leaves now: of the writes since the last flush none, or each by `chance`."""
        if chance is None:
            return bytes(self.durable)
        disk = bytearray(self.durable)
        for entry in self.pending:
            if chance.random() < 0.5:
                self._write(disk, entry)
        return bytes(disk)

    def everything(self) -> bytes:
        """The disk with all writes so far, flushed or not."""
        disk = bytearray(self.durable)
        for entry in self.pending:
            self._write(disk, entry)
        return bytes(disk)

    def _write(self, disk: bytearray, entry: Entry) -> None:
        disk[entry.at : entry.at + entry.size] = self.log.data(entry)

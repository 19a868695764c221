#!/usr/bin/env python3
"""Seeds the corpora from the recordings: corpus/TARGET/NAME, a few records each.

The first byte of an input chooses how it is split (see src/lib.rs), or the protocol
(dialogue)."""
import pathlib
import struct

HERE = pathlib.Path(__file__).parent
RECORDINGS = HERE.parent / "fixtures" / "tracker"
FASTRAK = {"fastrak-text": 47 * 4, "fastrak-binary": 32 * 4, "fastrak-noisy": 32 * 42}


def put(target, name, data):
    folder = HERE / "corpus" / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data)


for name, length in FASTRAK.items():
    put("fastrak", name, b"\x06" + (RECORDINGS / f"{name}.log").read_bytes()[-length:])
for name, length in {"liberty": 36 * 4, "flock": 14 * 4, "freed": 29 * 4, "csv": 340}.items():
    data = (RECORDINGS / f"{name}.log").read_bytes()[:length]
    put(name, "recording", b"\x06" + data)
    put("dialogue", name, b"\x07" + data)

cookie = b"vrpn: ver. 07.35  0".ljust(24, b"\0")


def message(sender, kind, payload):
    data = struct.pack(">Iiiiii", 24 + len(payload), 5, 6, sender, kind, 0) + payload
    return data + bytes(-len(data) % 8)


def name(number, kind, text):
    return message(number, kind, struct.pack(">I", len(text) + 1) + text + b"\0")


pose = struct.pack(">ii7d", 0, 0, 1, 2, 3, 0, 0, 0.6, 0.8)
server = name(0, -1, b"Tracker0") + name(1, -2, b"vrpn_Tracker Pos_Quat")
put("vrpn", "server", cookie + server + message(0, 1, pose) * 2)
put("vrpn", "poses", b"\x05" + message(0, 1, pose) * 3)


# A minimal session: MCAP encoded here, without compression or checksums.
def text(value):
    return struct.pack("<I", len(value)) + value


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def field(number, data):
    return bytes([number << 3 | 2, len(data)]) + data


def session():
    magic = b"\x89MCAP0\r\n"
    schemas = record(3, struct.pack("<H", 1) + text(b"foxglove.CompressedImage") + text(b"protobuf") + text(b""))
    schemas += record(3, struct.pack("<H", 2) + text(b"penumbra.TrackerBytes") + text(b"protobuf") + text(b""))
    protocol = text(b"protocol") + text(b"fastrak")
    channels = record(4, struct.pack("<HH", 1, 1) + text(b"/scene_camera/image") + text(b"protobuf") + text(b""))
    channels += record(4, struct.pack("<HH", 2, 2) + text(b"/tracker/bytes") + text(b"protobuf") + text(protocol))
    image = field(1, b"\x08\x01\x10\x02") + field(2, b"\xff\xd8\xff\xd9") + field(3, b"jpeg") + field(4, b"scene_camera")
    messages = b""
    for i in range(2):
        times = struct.pack("<QQ", 10 + i, 9 + i)
        messages += record(5, struct.pack("<HI", 1, i) + times + image)
        messages += record(5, struct.pack("<HI", 2, i) + times + field(1, b"01 "))
    inside = schemas + channels + messages
    chunk = struct.pack("<QQQI", 10, 11, len(inside), 0) + text(b"") + struct.pack("<Q", len(inside)) + inside
    end = record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0))
    return magic + record(1, text(b"") + text(b"penumbra")) + record(6, chunk) + end + magic


put("session", "small", session())

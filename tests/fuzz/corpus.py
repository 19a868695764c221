"""First inputs of the fuzz targets: from recordings, configuration and documentation of this repository, or made here.

The first byte of an input chooses how a tracker's bytes are split (src/trackers.rs), the protocol (dialogue), the file
(rig), the format (picture) or the server (http)."""
import json
import pathlib
import re
import shutil
import struct

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
RECORDINGS = ROOT / "tests/fixtures/tracker"
FASTRAK = {"fastrak-text": 47 * 4, "fastrak-binary": 32 * 4, "fastrak-noisy": 32 * 42}
MAX_BYTES = 4000


def trackers():
    for name, length in FASTRAK.items():
        yield "fastrak", b"\x06" + (RECORDINGS / f"{name}.log").read_bytes()[-length:]
    for name, length in {"liberty": 36 * 4, "flock": 14 * 4, "freed": 29 * 4, "csv": 340}.items():
        data = (RECORDINGS / f"{name}.log").read_bytes()[:length]
        yield name, b"\x06" + data
        yield "dialogue", b"\x07" + data
    pose = vrpn_message(0, 1, struct.pack(">ii7d", 0, 0, 1, 2, 3, 0, 0, 0.6, 0.8))
    server = vrpn_name(0, -1, b"Tracker0") + vrpn_name(1, -2, b"vrpn_Tracker Pos_Quat")
    yield "vrpn", b"vrpn: ver. 07.35  0".ljust(24, b"\0") + server + pose * 2
    yield "vrpn", b"\x05" + pose * 3


def vrpn_message(sender, kind, payload):
    data = struct.pack(">Iiiiii", 24 + len(payload), 5, 6, sender, kind, 0) + payload
    return data + bytes(-len(data) % 8)


def vrpn_name(number, kind, text):
    return vrpn_message(number, kind, struct.pack(">I", len(text) + 1) + text + b"\0")


def text(value):
    return struct.pack("<I", len(value)) + value


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def field(number, data):
    return bytes([number << 3 | 2, len(data)]) + data


def session():
    """A minimal session: MCAP without compression or checksums."""
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
    yield "session", magic + record(1, text(b"") + text(b"penumbra")) + record(6, chunk) + end + magic


def settings():
    """Configurations and scenes: those of the repository, and each table of the reference with every key."""
    lines = (ROOT / "config/rig.toml").read_text().splitlines()
    stated = [re.sub(r"^# (?=[a-z_]+ = )", "", line) for line in lines]
    tables = "\n".join(line for line in stated if line and not line.startswith("#")).split("\n[")
    for table in tables:
        yield "config", ("[" + table.removeprefix("[")).encode()
    for path in sorted((ROOT / "config").glob("*.toml")):
        content = "\n".join(line for line in path.read_text().splitlines() if not line.startswith("#")).encode()
        yield ("scene" if b"[[object]]" in content else "config"), content
    reference = (ROOT / "src/scene/scene_file.rs").read_text().split("```")[1]
    example = "\n".join(line.removeprefix("//!").removeprefix(" ") for line in reference.splitlines()[1:])
    example = example.replace("teapot.glb", "box.gltf")
    for table in re.split(r"\n\n", example):
        yield "scene", re.sub(r"\s+#.*", "", table).encode()
    for path in (ROOT / "docs/src").glob("*.md"):
        for block in re.findall(r"```toml\n(.*?)```", path.read_text(), re.S):
            yield ("scene" if "[[" in block else "config"), block.encode()


def models():
    model = (HERE / "companions/box.gltf").read_bytes()
    yield "gltf", model
    document = json.loads(model)
    document["buffers"][0].pop("uri")
    header = json.dumps(document, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 4)
    binary = bytes(document["buffers"][0]["byteLength"] + 3 & ~3)
    body = struct.pack("<I4s", len(header), b"JSON") + header + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    yield "gltf", b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body
    yield "ply", (HERE / "companions/triangle.ply").read_bytes()
    vertices = struct.pack(">18f", *[0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 1])
    names = "".join(f"property float {name}\n" for name in ["x", "y", "z", "nx", "ny", "nz"])
    head = f"ply\nformat binary_big_endian 1.0\nelement vertex 3\n{names}element face 1\n"
    yield "ply", (head + "property list uchar ushort vertex_index\nend_header\n").encode() + vertices + b"\x03" + struct.pack(">3H", 0, 1, 2)


#: Values by the keys of calibration files.
POSE = {"position": [0, 0, 1], "quaternion_wxyz": [1, 0, 0, 0]}
LENS = {"penumbra_calibration": 1, "date": "2026-11-26", "image_size": [640, 480], "focal": [500, 500], "centre": [320, 240]}
OFFSET = {"seconds": 0.03, "sigma": 0.001}


def rigs():
    for path in (ROOT / "docs/src").glob("*.md"):
        for block in re.findall(r"```json\n(.*?)```", path.read_text(), re.S):
            yield "rig", b"\0" + block.encode()
    steps = {
        1: {"step": "environment", "kind": "fisheye", "image_size": [640, 640], "T_world_cam": POSE, "by": "tags",
            "lens": {"centre": [320, 320], "radius": 300, "focal": 200, "distortion": [0, 0, 0, 0], "max_theta": 1.5, "sigma": [1, 1, 1]}},
        2: {"step": "latency", "tracker_minus_scene": OFFSET, "tracker_minus_environment": OFFSET},
        3: {**LENS, "camera": "scene", "model": "brown", "distortion": {"k1": 0.1, "k2": 0, "p1": 0, "p2": 0, "k3": 0}},
        4: {**LENS, "camera": "environment", "model": "fisheye", "max_theta": 1.5, "distortion": {"k1": 0, "k2": 0, "k3": 0, "k4": 0}},
        5: {"step": "markers", "markers": [{"family": "tag36h11", "id": 1, "size_m": 0.05, "pose": POSE}]},
        6: {"step": "radiometric", "scene_camera": {"response": {"linear_from_code": [i / 255 for i in range(256)]}},
            "gains": {"rgb": [1, 1, 1], "relative_sigma": [0.01, 0.01, 0.01], "method": "chart"}},
        7: {"step": "tracker", "world_from_transmitter": POSE, "sensor_from_scene_camera": POSE, "metres_per_unit": 1, "tracker_minus_scene": OFFSET},
    }
    for choice, values in steps.items():
        whole = {"penumbra_calibration": 1, "date": "2026-11-26", "verdict": "good", **values}
        yield "rig", bytes([choice]) + json.dumps(whole).encode()


def pictures():
    for path in sorted((ROOT / "tests/fixtures/jpeg").glob("*.jpg")):
        yield "picture", b"\0\0\0\0" + path.read_bytes()
        yield "picture", b"\x0a\0\0\0" + path.read_bytes()
    wood = (HERE / "companions/wood.png").read_bytes()
    yield "picture", b"\x01\0\0\0" + wood
    yield "picture", b"\x0a\0\0\0" + wood
    for choice in range(2, 10):
        yield "picture", bytes([choice, 4, 4, 3]) + bytes(range(64))


def requests():
    pages = ["/", "/dashboard/dashboard.js", "/status", "/metrics", "/healthz", "/log?after=3", "/stream.mjpeg", "/snapshot.png",
             "/environment.png", "/whitebalance.json", "/scenes", "/calibration", "/?token=a-token-for-tests"]
    for page in pages:
        yield "http", f"\0GET {page} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
    bodies = {
        "/settings": {"light_count": 64, "shadow_strength": 0.5, "technique": "image-based-shadowing", "exposure_ev": -1},
        "/recording": {"record": True, "file": "a.mcap", "seconds": 5}, "/playback": {"paused": True, "jump_to": 0.5},
        "/objects": {"at": [0.5, 0.5], "object": 0, "turn_deg": 30, "scale": 2}, "/scenes": {"show": "session"},
        "/scenes/save": {"file": "mine.toml"}, "/calibration": {"step": "intrinsics", "parameters": {"board": "charuco"}, "seconds": 5},
    }
    for page, body in bodies.items():
        data = json.dumps(body)
        head = f"POST {page} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nAuthorization: Bearer a-token-for-tests\r\n"
        yield "http", f"\1{head}Content-Length: {len(data)}\r\n\r\n{data}".encode()
        chunk = f"{len(data):x}\r\n{data}\r\n0\r\n\r\n"
        yield "http", f"\0{head}Transfer-Encoding: chunked\r\n\r\n{chunk}".encode()
    upload = "POST /scenes/upload?name=a%20b.ply HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/octet-stream\r\n"
    yield "http", f"\0{upload}Content-Length: 3\r\n\r\nplyGET /status HTTP/1.1\r\nHost: [::1]\r\n\r\n".encode()


def seed(folder):
    """Writes the first inputs to folder/TARGET."""
    for made in (trackers, session, settings, models, rigs, pictures, requests):
        for number, (target, data) in enumerate(made()):
            (folder / target).mkdir(parents=True, exist_ok=True)
            if len(data) <= MAX_BYTES:
                (folder / target / f"{made.__name__}-{number}").write_bytes(data)


def replace(kept, small):
    """Replaces a corpus of the repository by the inputs in `small`, named by their order of size."""
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    found = sorted((path.stat().st_size, path.read_bytes()) for path in small.iterdir())
    for number, (_, data) in enumerate(found):
        (kept / f"{number:03}").write_bytes(data)

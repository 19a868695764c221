#!/usr/bin/env python3
"""Check that other software can read sessions: opens one with the Python `mcap` package, by its
summary and sequentially, and decodes every Foxglove message.

    tests/judge/mcap_opens.py [SESSION.mcap]
"""
import sys
from collections import Counter
from pathlib import Path

from python_env import ROOT, Unavailable, run_with

REQUIREMENTS = Path(__file__).with_name("requirements-mcap.txt")
FOXGLOVE = {
    "/scene_camera/image": "foxglove.CompressedImage",
    "/scene_camera/calibration": "foxglove.CameraCalibration",
    "/environment_camera/image": "foxglove.CompressedImage",
    "/tf": "foxglove.FrameTransform",
}


def check(path: Path) -> list[str]:
    """Returns the defects of the session."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    wrong, counts, decoded, before = [], Counter(), Counter(), {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        names = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values() if c.schema_id}
        wrong += [f"{topic}: schema {names.get(topic)}, not {schema}" for topic, schema in FOXGLOVE.items() if names.get(topic) != schema]
        if "rig.json" not in {a.name for a in reader.iter_attachments()}:
            wrong.append("no attachment rig.json")
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            counts[channel.topic] += 1
            if message.log_time < before.get(channel.topic, 0):
                wrong.append(f"{channel.topic}: time decreases at {message.log_time}")
            before[channel.topic] = message.log_time
        for schema, channel, message, value in reader.iter_decoded_messages():
            decoded[channel.topic] += 1
            if schema.name == "foxglove.CompressedImage" and not bytes(value.data).startswith((b"\xff\xd8", b"\x89PNG")):
                wrong.append(f"{channel.topic}: {value.format} that starts with {bytes(value.data)[:4]}")
        expected = {summary.channels[i].topic: n for i, n in summary.statistics.channel_message_counts.items()}
    if not counts or expected != dict(counts) or counts != decoded:
        wrong.append(f"messages: summary {expected}, read {dict(counts)}, decoded {dict(decoded)}")
    print(f"{path.name}: {sum(counts.values())} messages on {len(counts)} topics read by the mcap package")
    return wrong


def main() -> int:
    session = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "tests/fixtures/sessions/desk.mcap"
    try:
        run_with(["mcap", "mcap_protobuf", "lz4", "zstandard"], REQUIREMENTS)
    except Unavailable as error:
        print(f"SKIPPED mcap_opens: {error}")
        return 0
    wrong = check(session)
    for line in wrong[:20]:
        print(f"{session}: {line}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

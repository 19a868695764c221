"""Reads a session with the `mcap` package alone and prints its contents.

Exits with 77 if the package is missing. Run by tests/session_python.rs.
"""

import json
import sys

try:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap.reader import make_reader
except ImportError as missing:
    print(f"missing: {missing}")
    sys.exit(77)


def decoder(schema):
    """Returns a class that decodes messages of a protobuf schema, built from the schema alone."""
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def nanos(stamp):
    return stamp.seconds * 10**9 + stamp.nanos


def describe(schema, channel, message):
    head = f"{message.log_time} {channel.topic} {schema.name}"
    if schema.encoding == "jsonschema":
        json.loads(schema.data)
        values = json.loads(message.data)
        return f"{head} {values['sequence']} {values['exposure_micros']} {values['gain']}"
    decoded = decoder(schema).FromString(message.data)
    if schema.name == "foxglove.CompressedImage":
        stamp = nanos(decoded.timestamp)
        return f"{head} {message.sequence} {stamp} {decoded.format} {decoded.data.decode()}"
    if schema.name == "foxglove.RawImage":
        size = f"{decoded.width}x{decoded.height}/{decoded.step}"
        return f"{head} {decoded.encoding} {size} {len(decoded.data)}"
    if schema.name == "penumbra.TrackerBytes":
        return f"{head} {channel.metadata['protocol']} {decoded.data.decode()}"
    if schema.name == "foxglove.FrameTransform":
        t, q = decoded.translation, decoded.rotation
        frames = f"{decoded.parent_frame_id} {decoded.child_frame_id}"
        return f"{head} {frames} {t.x} {t.y} {t.z} {q.x} {q.y} {q.z} {q.w}"
    return head


with open(sys.argv[1], "rb") as file:
    reader = make_reader(file)
    summary = reader.get_summary()
    print(f"messages {summary.statistics.message_count}")
    for schema, channel, message in reader.iter_messages():
        print(describe(schema, channel, message))
    for attachment in reader.iter_attachments():
        print(f"attachment {attachment.name} {attachment.media_type} {attachment.data.decode()}")

"""Extracts the uncompressed kernel from a Debian vmlinuz.

QEMU starts a vmlinux through its PVH entry, without a boot loader and without decompression,
which takes seconds under emulation.
Layout: Documentation/x86/boot.rst of the kernel, fields setup_sects and payload_offset.

usage: vmlinux.py VMLINUZ VMLINUX
"""

import lzma
import struct
import sys

XZ = b"\xfd7zXZ\0"


def payload(image: bytes) -> bytes:
    """The compressed kernel inside the boot image."""
    offset, length = struct.unpack_from("<II", image, 0x248)
    begin = (image[0x1F1] + 1) * 512 + offset
    if not image.startswith(XZ, begin):
        sys.exit("vmlinuz: its payload is not xz; this Debian compresses its kernel in another way")
    return image[begin : begin + length]


def main() -> None:
    source, target = sys.argv[1:]
    with open(source, "rb") as file:
        image = file.read()
    # The payload ends with its length in four bytes after the xz stream, which a decompressor ignores.
    kernel = lzma.LZMADecompressor().decompress(payload(image))
    with open(target, "wb") as file:
        file.write(kernel)


main()

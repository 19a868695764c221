"""Builds the programs and tests of the guest; prints one line for each: FOLDER NAME PATH.

A test that is in no list would never run, so this is an error.

usage: build.py LIST...     lists of tests, from tests/devices/lists
"""

import json
import pathlib
import subprocess
import sys

LISTS = pathlib.Path(__file__).parent / "lists"
# Test binary -> its package. Every line of a list begins with one of these.
PACKAGES = {
    "environment": "penumbra-guest",
    "program": "penumbra-guest",
    "kernel": "penumbra-camera-v4l2",
    "serial": "penumbra-guest",
}
# Programs under test, by the test binary that needs them: package, program.
PROGRAMS = {"program": ("penumbra", "penumbra")}
EMULATOR = ("penumbra-usbcam", "usbcam")


def main() -> None:
    tests = [line.split() for name in sys.argv[1:] for line in read_list(name)]
    binaries = sorted({test[0] for test in tests})
    programs = [EMULATOR] + [PROGRAMS[name] for name in binaries if name in PROGRAMS]
    for package, name in programs:
        print("bin", name, cargo("build", "-p", package, "--bin", name)[name])
    for name in binaries:
        path = cargo("test", "--no-run", "-p", PACKAGES[name], "--test", name)[name]
        refuse_unlisted(name, path)
        print("tests", name, path)


def read_list(name: str) -> list[str]:
    lines = (LISTS / name).read_text().splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def cargo(*arguments: str) -> dict[str, str]:
    """Builds executables; returns their paths by name. Optimised: the guest's emulated processor is some 20 times slower."""
    command = ["cargo", *arguments, "--release", "--locked", "--message-format=json-render-diagnostics"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(done.returncode)
    messages = [json.loads(line) for line in done.stdout.splitlines()]
    return {m["target"]["name"]: m["executable"] for m in messages if m.get("executable")}


def refuse_unlisted(binary: str, path: str) -> None:
    """Exits with an error if the binary has a test that is in no list."""
    printed = subprocess.run([path, "--list"], stdout=subprocess.PIPE, text=True, check=True).stdout
    there = {line.removesuffix(": test") for line in printed.splitlines() if line.endswith(": test")}
    lines = [line.split() for file in LISTS.iterdir() for line in read_list(file.name)]
    missing = there - {line[1] for line in lines if line[0] == binary}
    if missing:
        sys.exit(f"tests/devices/lists names no test {', '.join(sorted(missing))} of {binary}")


main()

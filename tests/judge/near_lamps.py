#!/usr/bin/env python3
"""What the estimated places and energies of lamps change, also where the rig's description is wrong.

Each rig with ground truth is replayed at live quality as it is, without its darkest exposure, with all phantoms displaced by
5 mm, and without each of its phantoms; each time with `light_places = "estimate"` and "far".

    tests/judge/near_lamps.py                                rigs of --truth, the table on stdout
    tests/judge/near_lamps.py --sessions desk,desk-near --write

Exit status: 0, 1 if the estimate is worse than "far" anywhere, 2 if something failed.
"""
from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from fidelity import PACKAGES, REQUIREMENTS, Failed, step
from python_env import TARGET, Unavailable, run_with
from rigs import FOLDERS, Rig, blind_view, outside
from tables import RESULTS, write_between

#: Rigs with a lamp.
LAMPS = "desk,desk-lamp,desk-near,desk-still"
#: Displacement of the phantoms, metres: 5 mm in all.
DISPLACED = (0.0035, 0.0035, 0.0)
#: Column of judge.py, heading, digits; a worse figure of any of them is a failure.
COLUMNS = [("s_err", "s_err", 4), ("dE", "dE", 2), ("dE_object", "dE_obj", 2), ("bad", "bad %", 2)]
#: Share by which a figure may be larger by the cameras' noise.
NOISE = 1.02


def displace(folder: Path, phantom: dict) -> None:
    """Moves a phantom, both its mesh (binary PLY in the world) and its pose."""
    import numpy as np

    path = folder / phantom["ply"]
    data = path.read_bytes()
    start = data.index(b"end_header\n") + len(b"end_header\n")
    header = data[:start].decode()
    count = int(header.split("element vertex ")[1].split()[0])
    floats = header.split("element vertex")[1].split("element face")[0].count("property float")
    vertices = np.frombuffer(data, "<f4", count * floats, start).reshape(count, floats).copy()
    vertices[:, :3] += np.array(DISPLACED, "f4")
    path.write_bytes(data[:start] + vertices.tobytes() + data[start + vertices.nbytes:])
    for row, by in zip(phantom["pose"]["matrix_row_major"], DISPLACED):
        row[3] += by
    phantom["pose"]["position"] = [x + by for x, by in zip(phantom["pose"]["position"], DISPLACED)]


def displace_all(folder: Path, rig: dict) -> None:
    for phantom in rig["phantoms"]:
        displace(folder, phantom)


def drop_exposure(folder: Path, rig: dict) -> None:
    """Removes the darkest bracketed exposure."""
    exposures = rig["environment_camera"]["brackets_ev"]
    darkest = min(exposures)
    exposures.remove(darkest)
    for picture in (folder / "env").glob(f"*_ev{darkest:g}.*"):
        picture.unlink()


def variants(rig: Rig) -> Iterator[tuple[str, Callable[[Path, dict], None]]]:
    """Names of the variants, each with what changes a copy of the rig's folder and its description."""
    yield "as it is", lambda folder, description: None
    yield "darkest exposure dropped", drop_exposure
    yield "phantoms displaced by 5 mm", displace_all
    for phantom in json.loads((rig.recording / "rig.json").read_text())["phantoms"]:
        name = phantom["name"]

        def drop(folder: Path, description: dict, name: str = name) -> None:
            description["phantoms"] = [p for p in description["phantoms"] if p["name"] != name]

        yield f"without the phantom {name}", drop


def judged(rig: Rig, number: int, change: Callable[[Path, dict], None], a: argparse.Namespace) -> list[dict[str, float]]:
    """The figures with estimated places, and with lamps infinitely far."""
    # Imports numpy, which this script's first Python may lack.
    from judge import judge_pictures

    work = a.out / rig.name / str(number)
    work.mkdir(parents=True, exist_ok=True)
    folder = blind_view(rig.recording, work / "rig")
    description = json.loads((folder / "rig.json").read_text())
    change(folder, description)
    (folder / "rig.json").write_text(json.dumps(description))
    log, session = work / "log.txt", work / "session.mcap"
    log.write_text("")
    step([str(a.penumbra), "import", str(folder), str(session), "--force"], log, "import")
    figures = []
    for places in ("estimate", "far"):
        config, frames = work / f"{places}.toml", work / places
        config.write_text(f'[environment]\nlight_places = "{places}"\n')
        step([str(a.penumbra), "replay", str(session), "--headless", "--listen", "127.0.0.1:0", "--speed", "max", "--quality", "live",
              "--config", str(config), "--frames-out", str(frames), "--force"], log, f"replay ({places})")
        figures.append(judge_pictures(rig.truth, frames, rig.every))
    return figures


def row(rig: str, variant: str, figures: list[dict[str, float]]) -> tuple[str, list[str]]:
    """A line of the table, and the figures that are worse with estimated places."""
    near, far = figures
    cells = [f"{far[column]:.{digits}f} → {near[column]:.{digits}f}" for column, _, digits in COLUMNS]
    worse = [heading for column, heading, digits in COLUMNS if near[column] > NOISE * far[column] + 0.5 * 10**-digits]
    return f"| {rig} | {variant} | {' | '.join(cells)} |", worse


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth", type=Path, action="append", help="folder of rigs with truth; may be repeated")
    parser.add_argument("--sessions", default=LAMPS, help="names of rigs, comma-separated (default: %(default)s)")
    parser.add_argument("--every", type=int, default=1, help="judge every N-th true frame")
    parser.add_argument("--penumbra", type=Path, default=TARGET / "release/penumbra", help="the program (default: the release build)")
    parser.add_argument("--write", action="store_true", help="put the table into docs/src/results/near-lamps.md")
    parser.add_argument("--out", type=Path, default=TARGET / "near-lamps", help="frames, logs")
    return parser.parse_args()


def main() -> int:
    a = options()
    lines = ["| rig | variant | " + " | ".join(heading for _, heading, _ in COLUMNS) + " |", "|---" * (len(COLUMNS) + 2) + "|"]
    worse = []
    try:
        run_with(PACKAGES, REQUIREMENTS)
        folders = a.truth or FOLDERS
        found = {rig.name: rig for folder in folders for rig in outside(folder, a.every)}
        missing = [name for name in a.sessions.split(",") if name not in found]
        for name in (name for name in a.sessions.split(",") if name in found):
            for number, (variant, change) in enumerate(variants(found[name])):
                line, slips = row(name, variant, judged(found[name], number, change, a))
                lines.append(line)
                worse += [f"{name}, {variant}: {what} is worse than without places" for what in slips]
                print(line, flush=True)
        if a.write and not missing:
            write_between(RESULTS / "near-lamps.md", "near-lamps", "\n".join(lines))
    except (Failed, Unavailable, OSError, ValueError, KeyError) as error:
        print(error, file=sys.stderr)
        return 2
    for name in missing:
        print(f"SKIPPED {name}: this rig is not part of the repository, and --truth has none of that name")
    for text in worse:
        print(f"WORSE {text}")
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""Compare calibration and registration with reference values and print a table of figures.

The program itself finds every figure (`penumbra calibrate ...`, `penumbra replay`), from published
pictures and recordings (--data) and from path-traced rigs with known truth (--truth, and --simulated,
made by tests/rigsim_calibration.py). It never gets the truth.

    tests/calibration.py                               everything for which there is data
    tests/calibration.py --only intrinsics,tracker     a part of it
    tests/calibration.py --simulated DIR --write       with simulated rigs; the table into docs/src/results/calibration.md

Exit status: 0 every bar is reached, 1 a bar is missed, 2 something failed. A part without data is
named as SKIPPED.
"""
from __future__ import annotations

import argparse
import json
import math
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from python_env import ROOT, TARGET, Unavailable, run_with
from rigs import blind_view
from tables import RESULTS, write_between

REQUIREMENTS = Path(__file__).with_name("requirements-calibration.txt")
PACKAGES = ["numpy", "cv2"]


class Failed(Exception):
    """A run failed; the text says which one and where its output is."""


class Skipped(Exception):
    """A part of the comparison has no data; the text says what is missing."""


@dataclass
class Row:
    """One figure, and the value that it must not exceed."""

    what: str
    figure: str
    reached: float
    allowed: float
    unit: str
    by: str

    @property
    def passed(self) -> bool:
        return self.reached <= self.allowed


class Judge:
    """Runs the program, each time in a folder of its own."""

    def __init__(self, a: argparse.Namespace) -> None:
        self.a, self.penumbra = a, str(a.penumbra)

    def folder(self, name: str) -> Path:
        folder = self.a.out / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return folder

    def run(self, work: Path, *arguments: object, refused: bool = False) -> str:
        """The program's output. `refused`: it must end with an error."""
        command = [self.penumbra, *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, cwd=work)
        said = done.stdout + done.stderr
        with (work / "log.txt").open("a") as log:
            log.write(f"\n$ {' '.join(command)}\n{said}")
        if (done.returncode != 0) != refused:
            last = next((line for line in reversed(said.splitlines()) if line.strip()), "")
            raise Failed(f"{' '.join(map(str, arguments[:2]))} ended with {done.returncode}: {last} (see {work / 'log.txt'})")
        return said

    def calibrate(self, work: Path, step: str, out: str, *arguments: object) -> dict:
        """The contents of the calibration file that a step of `penumbra calibrate` wrote."""
        path = work / out
        self.run(work, "calibrate", step, "--out", path, "--force", *arguments)
        return json.loads(path.read_text())

    def imported(self, work: Path, session: Path) -> Path:
        """A session file made from a rig's folder without the truth."""
        view = blind_view(session, work / "rig")
        mcap = work / "session.mcap"
        self.run(work, "import", view, mcap, "--force")
        return mcap

    def data(self, path: str) -> Path:
        found = self.a.data / path
        if not found.exists():
            raise Skipped(f"{found} is missing")
        return found


# ----------------------------------------------------------------------------- intrinsics


def opencv_chess(files: list[Path], board: tuple[int, int], fisheye: bool = False) -> float:
    """Reprojection RMS in pixels of OpenCV's calibration from the same pictures, without outlying views."""
    import cv2
    import numpy as np
    points = np.zeros((board[0] * board[1], 3), np.float32)
    points[:, :2] = np.mgrid[0:board[0], 0:board[1]].T.reshape(-1, 2)
    objects, pictures, size = [], [], None
    for file in files:
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        found, corners = cv2.findChessboardCorners(grey, board)
        if not found:
            continue
        size = grey.shape[::-1]
        corners = cv2.cornerSubPix(grey, corners.astype(np.float32), (11, 11), (-1, -1), (3, 30, 1e-3))
        objects.append(points)
        pictures.append(corners)
    if fisheye:
        # OpenCV 5 moved these flags out of cv2.fisheye.
        flags = sum(getattr(cv2.fisheye, n, None) or getattr(cv2, n) for n in ("CALIB_USE_INTRINSIC_GUESS", "CALIB_RECOMPUTE_EXTRINSIC", "CALIB_FIX_SKEW"))
        K = np.array([[size[0] / 3, 0, size[0] / 2], [0, size[0] / 3, size[1] / 2], [0, 0, 1]])
        rms, *_ = cv2.fisheye.calibrate(
            [o[None].astype(np.float64) for o in objects], [p.reshape(1, -1, 2).astype(np.float64) for p in pictures],
            size, K, np.zeros((4, 1)), flags=flags, criteria=(3, 100, 1e-9))
    else:
        per_view = cv2.calibrateCameraExtended(objects, pictures, size, np.eye(3), np.zeros(5))[-1].ravel()
        # Penumbra leaves out blurred views, so OpenCV must, too.
        kept = np.flatnonzero(per_view < 3 * np.median(per_view))
        rms, *_ = cv2.calibrateCamera([objects[i] for i in kept], [pictures[i] for i in kept], size, np.eye(3), np.zeros(5))
    return float(rms)


def published_focal(file: Path, matrix: str) -> float:
    """fx of a camera matrix in an OpenCV file. cv2 cannot read files of its first versions."""
    after = file.read_text().partition(f"{matrix}:")[2].partition("data: [")[2]
    return float(after.split(",")[0])


def linked(work: Path, files: list[Path]) -> Path:
    folder = work / "pictures"
    folder.mkdir()
    for file in files:
        shutil.copyfile(file, folder / file.name)
    return folder


def chess(j: Judge) -> Iterator[Row]:
    folder = j.data("calibration/opencv_stereo_chess")
    published = {
        "left": ("left_intrinsics.yml", "camera_matrix", "published"),
        "right": ("intrinsics.yml", "M2", "published, one focal length for both cameras"),
    }
    for side in published:
        files = sorted(folder.glob(f"{side}[0-9]*.jpg"))
        work = j.folder(f"chess-{side}")
        lens = j.calibrate(work, "intrinsics", "lens.json", "--pictures", linked(work, files), "--board", "chess:9x6:0.025")
        rms = opencv_chess(files, (9, 6))
        yield Row(f"chessboard, {side}", "reprojection", lens["quality"]["rms"], rms, "px RMS", "OpenCV on the same pictures")
        file, matrix, by = published[side]
        off = 100 * abs(lens["focal"][0] / published_focal(folder / file, matrix) - 1)
        yield Row(f"chessboard, {side}", "focal length", off, 0.5, "%", by)


def fisheye_chess(j: Judge) -> Iterator[Row]:
    files = sorted(j.data("probes-fisheye/fisheye/ocam_fisheye1").glob("Fisheye1_*.jpg"))
    work = j.folder("chess-fisheye")
    lens = j.calibrate(work, "intrinsics", "lens.json", "--pictures", linked(work, files), "--board", "chess:8x6:0.0325", "--model", "fisheye", "--free-aspect")
    rms = opencv_chess(files, (8, 6), fisheye=True)
    yield Row("fisheye chessboard", "reprojection", lens["quality"]["rms"], rms, "px RMS", "OpenCV on the same pictures")


def simulated(j: Judge, pattern: str) -> list[Path]:
    found = sorted(j.a.simulated.glob(f"{pattern}*/truth_rig.json")) if j.a.simulated else []
    if not found:
        raise Skipped(f"no rigs {pattern}* (--simulated; made by tests/rigsim_calibration.py)")
    return [path.parent for path in found]


def simulated_lens(j: Judge) -> Iterator[Row]:
    import numpy as np
    for session in simulated(j, "board"):
        truth = json.loads((session / "truth_rig.json").read_text())["scene_camera"]
        work = j.folder(session.name)
        mcap = j.imported(work, session)
        board = json.loads((session / "board.json").read_text())["board"]
        lens = j.calibrate(work, "intrinsics", "lens.json", "--session", mcap, "--board", board)
        K = np.array(truth["K"])
        off = 100 * max(abs(lens["focal"][0] / K[0, 0] - 1), abs(lens["focal"][1] / K[1, 1] - 1))
        yield Row(f"{session.name} ({board})", "focal length", off, 0.5, "%", "truth")
        # The error must lie within three of the standard deviations that the program reports.
        allowed = 3 * lens["quality"]["projection_sigma"][1]
        yield Row(f"{session.name} ({board})", "whole lens", lens_error(lens, truth), allowed, "px, 95th percentile", "truth; 3σ of the program's own")


def lens_error(lens: dict, truth: dict) -> float:
    """Distance in pixels between the projections of the same rays by both lenses, 95th percentile over the picture.

    The best rotation between the two cameras is taken out first.
    """
    import cv2
    import numpy as np
    w, h = lens["image_size"]
    u, v = np.meshgrid(np.linspace(0, w - 1, 33), np.linspace(0, h - 1, 25))
    pixels = np.stack([u.ravel(), v.ravel()], -1)
    names = ("k1", "k2", "p1", "p2", "k3")
    k = lambda d: np.array([d.get(n, 0.0) for n in names])
    found_K = np.array([[lens["focal"][0], 0, lens["centre"][0]], [0, lens["focal"][1], lens["centre"][1]], [0, 0, 1.0]])
    true_K, true_k = np.array(truth["K"]), k(truth["lens_distortion"])

    def rays(K: np.ndarray, d: np.ndarray) -> np.ndarray:
        """Rays through the pixels, z = 1: inverse of Brown's distortion (1966) by fixed-point iteration."""
        seen = (pixels - K[:2, 2]) / K[[0, 1], [0, 1]]
        k1, k2, p1, p2, k3 = d
        found = seen
        for _ in range(60):
            x, y = found.T
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            bent = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], -1)
            found = (seen - bent) / radial[:, None]
        return found

    unit = lambda p: np.pad(p, ((0, 0), (0, 1)), constant_values=1) / np.hypot(1, np.linalg.norm(p, axis=1))[:, None]
    found, true = unit(rays(found_K, k(lens["distortion"]))), unit(rays(true_K, true_k))
    left, _, right = np.linalg.svd(found.T @ true)
    turn = (left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right).T
    turned = found @ turn.T
    back, _ = cv2.projectPoints(turned, np.zeros(3), np.zeros(3), true_K, true_k)
    return float(np.percentile(np.linalg.norm(back[:, 0] - pixels, axis=1), 95))


# ----------------------------------------------------------------------------- tracker, latency, map


def pose(record: dict) -> tuple:
    """(rotation matrix, position) of a pose in a calibration file or a rig.json."""
    import numpy as np
    if "matrix_row_major" in record and "position_sigma" not in record:
        T = np.array(record["matrix_row_major"])
        return T[:3, :3], T[:3, 3]
    w, x, y, z = record["quaternion_wxyz"]
    R = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                  [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                  [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
    return R, np.array(record["position"])


def apart(found: dict, true: dict) -> tuple[float, float]:
    """Distance in millimetres and angle in degrees between two poses."""
    import numpy as np
    (R, t), (S, u) = pose(found), pose(true)
    turn = math.degrees(math.acos(min(1.0, max(-1.0, (np.trace(R.T @ S) - 1) / 2))))
    return 1e3 * float(np.linalg.norm(t - u)), turn


def truth_of(session: Path) -> dict:
    return json.loads((session / "truth_rig.json").read_text())


def waved(j: Judge) -> Iterator[Row]:
    """Mounting and latency of a rig, then `verify` of the whole rig with the values found."""
    for session in simulated(j, "waved"):
        truth, work = truth_of(session)["tracker"], j.folder(session.name)
        mcap = j.imported(work, session)
        calibration = work / "rig/calibration"
        calibration.mkdir()
        metal = json.loads((session / "made.json").read_text())["metal"] > 0 if (session / "made.json").exists() else False
        extra = ["--distortion"] if metal else []
        latency = j.calibrate(work, "latency", "rig/calibration/latency.json", "--session", mcap)["tracker_minus_scene"]
        yield Row(session.name, "latency", 1e3 * abs(latency["seconds"] - truth["latency_s"]), 2.0, "ms", "truth")
        tracker = j.calibrate(work, "tracker", "rig/calibration/tracker.json", "--session", mcap, *extra)
        if not metal:
            for key, true, name in (("sensor_from_scene_camera", "T_sensor_cam", "camera on sensor"),
                                    ("world_from_transmitter", "T_world_source", "transmitter in world")):
                mm, degrees = apart(tracker[key], truth[true])
                yield Row(session.name, f"{name}, position", mm, 1.0, "mm", "truth")
                yield Row(session.name, f"{name}, rotation", degrees, 0.1, "degrees", "truth")
        whole = work / "whole.mcap"
        j.run(work, "import", work / "rig", whole, "--force")
        check = j.calibrate(work, "verify", "check.json", "--session", whole)
        bent = ", distorted tracker field" if metal else ""
        yield Row(session.name, f"markers by the tracker alone{bent}", check["reprojection_px"], 1.0, "px RMS", "markers")
        latency = without_markers(j, work)
        yield Row(session.name, f"latency by {latency['by']}, mounting known", 1e3 * abs(latency["seconds"] - truth["latency_s"]), 2.0, "ms", "truth")


def without_markers(j: Judge, work: Path) -> dict:
    """The latency once more, from the mounting that was found and without the tags."""
    rig = work / "unmarked"
    shutil.copytree(work / "rig", rig)
    (rig / "calibration/latency.json").unlink()
    known = json.loads((rig / "rig.json").read_text())
    known.pop("markers")
    (rig / "rig.json").write_text(json.dumps(known))
    j.run(work, "import", rig, "unmarked.mcap", "--force")
    return j.calibrate(work, "latency", "unmarked-latency.json", "--session", "unmarked.mcap")["tracker_minus_scene"]


def true_poses(session: Path):
    """The camera's true pose from camera_truth.csv, as a function of the capture time in nanoseconds."""
    import numpy as np
    table = np.loadtxt(session / "camera_truth.csv", delimiter=",", skiprows=1)
    times, places, turns = table[:, 0], table[:, 1:4], table[:, 4:8]
    turns = turns * np.where(np.cumprod(np.r_[1, np.sign((turns[1:] * turns[:-1]).sum(1))]) < 0, -1, 1)[:, None]

    def at(ns: float) -> tuple:
        # Readings are 8 ms apart, so linear interpolation is off by less than 0.01 mm.
        q = np.array([np.interp(ns, times, turns[:, k]) for k in range(4)])
        place = np.array([np.interp(ns, times, places[:, k]) for k in range(3)])
        return pose({"quaternion_wxyz": q / np.linalg.norm(q), "position": place})

    return at


class Registered:
    """Errors in pixels of a replay's poses: distances between a box's corners projected by found and by true pose."""

    def __init__(self, j: Judge, work: Path, whole: Path, how: str, scene_camera: dict, box, at: Callable, predict: str = "picture") -> None:
        import csv
        import numpy as np
        self.K = np.array(scene_camera["K"])
        bent = scene_camera["lens_distortion"]
        self.bent = np.array([bent[k] for k in ("k1", "k2", "p1", "p2", "k3")] if isinstance(bent, dict) else bent)
        self.box, self.at = np.array(box), at
        (work / "c.toml").write_text(f'[registration]\npose = "{how}"\npredict = "{predict}"\n')
        j.run(work, "replay", whole, "--config", "c.toml", "--headless", "--listen", "127.0.0.1:0", "--speed", "max", "--poses-out", "poses.csv")
        self.rows = [row for row in csv.DictReader((work / "poses.csv").open()) if row["x"]]

    def places(self, p: tuple):
        import cv2
        import numpy as np
        return cv2.projectPoints((self.box - p[1]) @ p[0], np.zeros(3), np.zeros(3), self.K, self.bent)[0][:, 0]

    def told(self, row: dict, prefix: str = "") -> tuple:
        return pose({"quaternion_wxyz": [float(row[prefix + k]) for k in ("qw", "qx", "qy", "qz")], "position": [float(row[prefix + k]) for k in "xyz"]})

    def off(self, row: dict, prefix: str, nanos: float):
        import numpy as np
        return np.linalg.norm(self.places(self.told(row, prefix)) - self.places(self.at(nanos)), axis=1)

    def as_taken(self) -> float:
        import numpy as np
        return float(np.sqrt(np.mean([self.off(row, "", float(row["captured_ns"])) ** 2 for row in self.rows])))

    def as_seen(self, what: str, how: str, until: float) -> Iterator[Row]:
        """Errors at the instant of display; `until` is the last instant for which the truth is known, in nanoseconds."""
        import numpy as np
        rows = [row for row in self.rows if row["shown_x"] and row["shown_sigma_px"] and float(row["shown_ns"]) <= until]
        rms = lambda x: float(np.sqrt(np.mean(np.square(x))))
        shown = [self.off(row, "shown_", float(row["shown_ns"])) for row in rows]
        behind = rms([self.off(row, "", float(row["shown_ns"])) for row in rows])
        told = rms([float(row["shown_sigma_px"]) for row in rows]) * math.sqrt(2)
        ahead = 1e-6 * float(np.median([float(row["shown_ns"]) - float(row["captured_ns"]) for row in rows]))
        yield Row(what, f"object by {how}, displayed {ahead:.0f} ms later, {len(rows)} pictures", rms(shown), 0.5 * behind, "px RMS", f"truth; half the error without prediction ({behind:.2f})")
        yield Row(what, "that error, relative to the reported one", rms(shown) / told, 1.25, "times", f"truth ({told:.2f} px reported)")


def registration(j: Judge) -> Iterator[Row]:
    """Errors in pixels of the composited object's position, in each picture of a rig with true poses."""
    import numpy as np
    for session in simulated(j, "waved"):
        truth, whole = truth_of(session), j.a.out / session.name / "whole.mcap"
        if not whole.exists():
            raise Skipped("no calibrated rigs; run the part `tracker` first")
        R, t = pose(truth["object"]["T_world_object"])
        box = np.array(BOX) @ R.T + t
        at = true_poses(session)
        for how in ("tracker", "markers", "hybrid"):
            work = j.folder(f"{session.name}-{how}")
            found = Registered(j, work, whole, how, truth["scene_camera"], box, at)
            yield Row(session.name, f"object by {how}, {len(found.rows)} pictures", found.as_taken(), 1.0, "px RMS", "truth")
        for how in ("markers", "hybrid"):
            work = j.folder(f"{session.name}-{how}-display")
            found = Registered(j, work, whole, how, truth["scene_camera"], box, at, "display")
            yield from found.as_seen(session.name, how, np.inf)


#: Rigs that `penumbra simulate session` draws within seconds: seed -> further options.
DRAWN = {
    1: [],
    2: ["--gaps", "0.03", "--jumps", "0.005", "--blur", "1.0"],
    3: ["--motion", "slow", "--camera-latency", "0.021", "--tracker-latency", "0.006", "--noise", "4"],
}


def drawn(j: Judge) -> Iterator[Row]:
    """Simulated rigs in front of tags: mounting, latency, then the object's position when all is known."""
    import numpy as np
    for seed, options in DRAWN.items():
        what, work = " ".join([f"simulated rig {seed}", *options]), j.folder(f"drawn-{seed}")
        make = lambda name, *more: j.run(work, "simulate", "session", "--seed", seed, "--seconds", 12, *options, "--known-markers", *more, "--out", f"{name}.mcap", "--truth", f"{name}.json")
        make("blind")
        truth = json.loads((work / "blind.json").read_text())
        latency = j.calibrate(work, "latency", "latency.json", "--session", "blind.mcap")["tracker_minus_scene"]
        true_offset = truth["tracker_latency_s"] - truth["scene_camera_latency_s"]
        yield Row(what, f"latency by {latency['by']}", 1e3 * abs(latency["seconds"] - true_offset), 2.0, "ms", "truth")
        tracker = j.calibrate(work, "tracker", "tracker.json", "--session", "blind.mcap")
        for key, true, name in (("sensor_from_scene_camera", "T_sensor_cam", "camera on sensor"),
                                ("world_from_transmitter", "T_world_source", "transmitter in world")):
            mm, degrees = apart(tracker[key], truth[true])
            yield Row(what, f"{name}, position", mm, 1.0, "mm", "truth")
            yield Row(what, f"{name}, rotation", degrees, 0.1, "degrees", "truth")
        if "slow" not in options:
            j.run(work, "simulate", "session", "--seed", seed, "--seconds", 20, *options, "--out", "unmarked.mcap", "--truth", "unmarked.json")
            latency = j.calibrate(work, "latency", "unmarked-latency.json", "--session", "unmarked.mcap")["tracker_minus_scene"]
            yield Row(what, f"latency by {latency['by']}", 1e3 * abs(latency["seconds"] - true_offset), 2.0, "ms", "truth")
        make("known", "--known-tracker")
        truth = json.loads((work / "known.json").read_text())
        times = np.array([f["capture_ns"] for f in truth["frames"]], float)
        for how, bar in (("tracker", 1.0), ("hybrid", 1.0)):
            folder = j.folder(f"drawn-{seed}-{how}")
            found = Registered(j, folder, work / "known.mcap", how, truth["scene_camera"], BOX, drawn_poses(truth), "display")
            yield Row(what, f"object by {how}, {len(found.rows)} pictures", found.as_taken(), bar, "px RMS", "truth")
            yield from found.as_seen(what, how, times[-1])


#: Corners of a box about the object, in metres.
BOX = [[x, y, z] for x in (-0.07, 0.07) for y in (-0.07, 0.07) for z in (0, 0.11)]


def drawn_poses(truth: dict) -> Callable:
    """The true pose of a simulated rig as a function of time: a cubic through the poses of four pictures."""
    import numpy as np
    frames = [(f["capture_ns"], *pose(f["T_world_cam"])) for f in truth["frames"]]
    times = np.array([f[0] for f in frames], float)

    def at(ns: float) -> tuple:
        first = int(np.clip(np.searchsorted(times, ns) - 2, 0, len(times) - 4))
        t = times[first:first + 4]
        weight = [np.prod([(ns - t[b]) / (t[a] - t[b]) for b in range(4) if b != a]) for a in range(4)]
        R = sum(w * frames[first + a][1] for a, w in enumerate(weight))
        left, _, right = np.linalg.svd(R)
        return left @ right, sum(w * frames[first + a][2] for a, w in enumerate(weight))

    return at


def tag_map(j: Judge) -> Iterator[Row]:
    import numpy as np
    for session in simulated(j, "waved"):
        work = j.folder(f"{session.name}-map")
        true = {m["id"]: m for m in json.loads((session / "rig.json").read_text())["markers"]}
        view = blind_view(session, work / "rig")
        rig = json.loads((view / "rig.json").read_text())
        size = rig.pop("markers")[0]["size_m"]
        (view / "rig.json").write_text(json.dumps(rig))
        mcap = work / "session.mcap"
        j.run(work, "import", view, mcap, "--force")
        found = j.calibrate(work, "map", "markers.json", "--session", mcap, "--size", size, "--origin", 0)
        found = {m["id"]: m["pose"] for m in found["markers"]}
        worst = [0.0, 0.0]
        R0, t0 = pose(true[0]["T_world_marker"])
        F0, f0 = pose(found[0])
        for id, marker in true.items():
            # The box hides this tag in every picture.
            if id not in found:
                continue
            (R, t), (F, f) = pose(marker["T_world_marker"]), pose(found[id])
            turn = (R0.T @ R).T @ (F0.T @ F)
            worst[0] = max(worst[0], 1e3 * float(np.linalg.norm(R0.T @ (t - t0) - F0.T @ (f - f0))))
            worst[1] = max(worst[1], math.degrees(math.acos(min(1.0, (np.trace(turn) - 1) / 2))))
        yield Row(f"{session.name}, {len(found)} of {len(true)} tags", "map, worst position", worst[0], 1.0, "mm", "truth")
        yield Row(f"{session.name}, {len(found)} of {len(true)} tags", "map, worst rotation", worst[1], 0.5, "degrees", "truth")


def environment(j: Judge) -> Iterator[Row]:
    """The environment camera's pose, found from the tags that it sees; rig.json has it five degrees off."""
    for session in simulated(j, "fisheye"):
        work = j.folder(session.name)
        mcap = j.imported(work, session)
        found = j.calibrate(work, "environment", "environment.json", "--session", mcap)
        mm, degrees = apart(found["T_world_cam"], truth_of(session)["environment_camera"]["T_world_cam"])
        yield Row(session.name, f"environment camera's rotation by {found['by']}", degrees, 0.5, "degrees", "truth")
        yield Row(session.name, f"its position by {found['by']}", mm, 10.0, "mm", "truth")


# ----------------------------------------------------------------------------- tags


def tags_of(j: Judge, name: str, files: list[Path], family: str) -> dict[tuple[str, str], list]:
    """(picture, tag number) -> the tags found, each as its corners clockwise from the top left."""
    import csv
    work = j.folder(name)
    j.run(work, "calibrate", "tags", "--pictures", linked(work, files), "--family", family, "--out", "tags.csv")
    found: dict[tuple[str, str], list] = {}
    for row in csv.DictReader((work / "tags.csv").open()):
        corners = [[float(row[f"{axis}{k}"]) for axis in "xy"] for k in range(4)]
        found.setdefault((row["picture"], row["id"]), []).append(corners)
    return found


def aruco(j: Judge) -> Iterator[Row]:
    """OpenCV's test pictures: every expected marker must be found, and corners must fit their board's plane better than OpenCV's."""
    import cv2
    import numpy as np
    file = j.data("calibration/aruco_photos/expected_corners.json")
    expected = json.loads(file.read_text())
    found = {}
    for name in (n for n in expected if n.endswith(".jpg")):
        tags = tags_of(j, f"tags-{Path(name).stem}", [file.with_name(name)], "6x6_250")
        found[name] = {int(number): np.array(corners[0]) for (_, number), corners in tags.items()}
        missing = sum(int(number) not in found[name] for number in expected[name])
        yield Row(f"{name}, {len(expected[name])} markers", "not found", missing, 0, "markers", "OpenCV's expected ones")
    name = "chocclusion_original.jpg"
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250)
    board = cv2.aruco.CharucoBoard((5, 7), 0.04, 0.02, dictionary)
    places = {int(i): np.array(o)[:, :2].astype(float) for i, o in zip(np.ravel(board.getIds()), board.getObjPoints())}

    def off_plane(markers: dict) -> float:
        shared = [i for i in markers if i in places and i in found[name]]
        there, seen = (np.concatenate([which[i] for i in shared]) for which in (places, markers))
        H, _ = cv2.findHomography(there, seen, 0)
        return float(np.sqrt(np.mean(np.sum((cv2.perspectiveTransform(there[None], H)[0] - seen) ** 2, axis=1))))

    theirs = []
    for refinement in range(4):
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = refinement
        grey = cv2.imread(str(file.with_name(name)), cv2.IMREAD_GRAYSCALE)
        corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
        theirs.append(off_plane({int(i): c[0].astype(float) for i, c in zip(ids.ravel(), corners)}))
    yield Row(name, "corners off their board's plane", off_plane(found[name]), min(theirs), "px RMS", "the best of OpenCV's four refinements")


#: Expected tags that the AprilTag library (C 3.2) does not find itself: picture -> number of tags.
LIBRARY_MISSES = {"34085369442_304b6bafd9_c": 2}


def apriltags(j: Judge) -> Iterator[Row]:
    """Photographs with many small tags, and the tags that the authors of the AprilTag library expect in them."""
    import re
    import numpy as np
    folder = j.data("calibration/apriltag_nasa")
    for file in sorted(folder.glob("*.jpg")):
        found = tags_of(j, f"tags-{file.stem}", [file], "tag36h11")
        there = {number: [np.array(c) for c in each] for (_, number), each in found.items()}
        lines = [line for line in file.with_suffix(".txt").read_text().splitlines() if line.strip()]
        missing, off = 0, []
        for line in lines:
            numbers = [float(n) for n in re.findall(r"[-\d.]+", line)]
            # In their coordinates the centre of the top-left pixel is (0.5, 0.5), in ours (0, 0).
            corners = np.array(numbers[1:9]).reshape(4, 2) - 0.5
            near = [c for c in there.get(str(int(numbers[0])), []) if np.linalg.norm(c.mean(0) - corners.mean(0)) < 4]
            if not near:
                missing += 1
                continue
            # They start at another corner and go round in the other direction.
            ways = [np.roll(way, k, 0) for way in (near[0], near[0][::-1]) for k in range(4)]
            off += list(min((np.linalg.norm(way - corners, axis=1) for way in ways), key=np.sum))
        what = f"{file.name}, {len(lines)} tags"
        yield Row(what, "not found", missing, LIBRARY_MISSES.get(file.stem, 0), "tags", "the AprilTag library (C 3.2, in full size)")
        if off:
            yield Row(what, "corners", float(np.sqrt(np.mean(np.square(off)))), 1.0, "px RMS", "the AprilTag library's")


def grids(j: Judge) -> Iterator[Row]:
    """Photographs of Kalibr's boards from two published data sets."""
    for name, path in (("EuRoC", "calibration/aprilgrid/EuRoC.png"), ("TUM VI, fisheye", "probes-fisheye/fisheye/tumvi_aprilgrid/TUM_VI.png")):
        found = tags_of(j, f"tags-{name.split(',')[0].replace(' ', '')}", [j.data(path)], "kalibr36h11")
        on_board = {number for _, number in found if int(number) < 36}
        yield Row(f"AprilGrid of {name}", "not found of 36", 36 - len(on_board), 0, "tags", "the board")


# ----------------------------------------------------------------------------- colour


#: Linear gains of the copies, as if another camera had taken them.
OTHER_CAMERA = (0.62, 0.8, 0.95)


def charts(j: Judge) -> Iterator[Row]:
    """Photographs of ColorCheckers, and copies with known gains, which the white balance must find."""
    import cv2
    import numpy as np
    folder = j.data("colorchecker")
    photographs = sorted(folder.glob("arcu/*.jpg")) + sorted(folder.glob("macduff/*.jpg"))
    worst = 0.0
    for file in photographs:
        work = j.folder(f"chart-{file.stem}")
        code = cv2.imread(str(file), cv2.IMREAD_COLOR)[:, :, ::-1] / 255.0
        linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4) * OTHER_CAMERA
        code = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        other = work / "other.png"
        cv2.imwrite(str(other), (255 * code[:, :, ::-1]).round().astype(np.uint8))
        found = j.calibrate(work, "photometric", "photometric.json", "--scene-picture", file, "--environment-picture", other)
        off = [100 * abs(g * o - 1) for g, o in zip(found["gains"]["rgb"], OTHER_CAMERA)]
        worst = max(worst, *off)
    yield Row(f"{len(photographs)} photographs of ColorCheckers", "white balance, worst of all", worst, 2.0, "%, worst channel", "known gains")


def white_balance(j: Judge) -> Iterator[Row]:
    for session in sorted(path.parent for path in j.a.truth.glob("*/truth_rig.json")):
        truth = truth_of(session)
        if "environment_camera" not in truth:
            continue
        work = j.folder(f"{session.name}-photometric")
        mcap = j.imported(work, session)
        found = j.calibrate(work, "photometric", "photometric.json", "--session", mcap)
        total = [truth[c]["response_truth"]["total_gain_rgb"] for c in ("scene_camera", "environment_camera")]
        off = [100 * abs(g / (s / e) - 1) for g, s, e in zip(found["gains"]["rgb"], *total)]
        yield Row(session.name, f"white balance by {found['gains']['method']}", max(off), 2.0, "%, worst channel", "truth")


# ----------------------------------------------------------------------------- the table

TASKS: dict[str, list[Callable[[Judge], Iterator[Row]]]] = {
    "intrinsics": [chess, fisheye_chess, simulated_lens],
    "tracker": [drawn, waved, tag_map],
    "registration": [registration],
    "environment": [environment],
    "tags": [aruco, apriltags, grids],
    "colour": [white_balance, charts],
}


def table(rows: list[Row]) -> str:
    lines = ["| on | figure | reached | allowed | | judged by |", "|---|---|---|---|---|---|"]
    for r in rows:
        mark = "" if r.passed else " **FAIL**"
        lines.append(f"| {r.what} | {r.figure} | {r.reached:.3f} {r.unit} | {r.allowed:.3f} |{mark} | {r.by} |")
    return "\n".join(lines)


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT / "../shared/data", help="published pictures and calibrations")
    parser.add_argument("--truth", type=Path, default=ROOT / "../shared/truth", help="path-traced rigs")
    parser.add_argument("--simulated", type=Path, help="folder of rigs of tests/rigsim_calibration.py")
    parser.add_argument("--only", help=f"parts, comma-separated: {', '.join(TASKS)}")
    parser.add_argument("--penumbra", type=Path, help="the program (default: the release build)")
    parser.add_argument("--write", nargs="?", type=Path, const=RESULTS / "calibration.md", metavar="FILE",
                        help="put the table into a document, between its comments calibration:begin and calibration:end (default: %(const)s)")
    parser.add_argument("--out", type=Path, default=TARGET / "calibration", help="files of the runs, table.md")
    a = parser.parse_args()
    a.data, a.truth, a.out = a.data.resolve(), a.truth.resolve(), a.out.resolve()
    a.simulated = a.simulated.resolve() if a.simulated else None
    a.penumbra = (a.penumbra or TARGET / "release/penumbra").resolve()
    return a


def main() -> int:
    a = options()
    try:
        run_with(PACKAGES, REQUIREMENTS)
    except Unavailable as error:
        print(error, file=sys.stderr)
        return 2
    wanted = a.only.split(",") if a.only else list(TASKS)
    if unknown := set(wanted) - set(TASKS):
        print(f"--only: no {', '.join(sorted(unknown))}; there are {', '.join(TASKS)}", file=sys.stderr)
        return 2
    if not a.penumbra.exists():
        print(f"{a.penumbra} is missing; run `make build`", file=sys.stderr)
        return 2
    judge, rows, failed = Judge(a), [], 0
    for task in (task for name in wanted for task in TASKS[name]):
        try:
            for row in task(judge):
                rows.append(row)
                print(f"{row.what}: {row.figure} {row.reached:.3f} {row.unit} (allowed {row.allowed:.3f})", file=sys.stderr)
        except Skipped as reason:
            print(f"SKIPPED {task.__name__}: {reason}")
        except (Failed, OSError, KeyError, ValueError) as error:
            failed += 1
            print(f"FAILED {task.__name__}: {error}", file=sys.stderr)
    text = table(rows)
    a.out.mkdir(parents=True, exist_ok=True)
    (a.out / "table.md").write_text(text + "\n")
    print(text)
    missed = sum(not r.passed for r in rows)
    if a.write and not failed:
        try:
            write_between(a.write, "calibration", text)
        except (OSError, ValueError) as error:
            print(error, file=sys.stderr)
            return 2
    print(f"\n{len(rows)} figures, {missed} miss their bar, {failed} runs failed; {a.out / 'table.md'}")
    return 2 if failed or not rows else 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

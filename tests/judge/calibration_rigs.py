"""Rigs with ground truth: mounting, latency, tag map, environment camera, and registration of the virtual object."""
from __future__ import annotations

import csv
import json
import math
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from calibration_judge import Judge, Row, Skipped, truth_of
from rigs import blind_view

#: A rotation matrix and a position, metres.
Pose = tuple[np.ndarray, np.ndarray]


def pose(record: dict) -> Pose:
    """Parses a pose of a calibration file or a rig.json."""
    if "matrix_row_major" in record and "position_sigma" not in record:
        T = np.array(record["matrix_row_major"])
        return T[:3, :3], T[:3, 3]
    w, x, y, z = record["quaternion_wxyz"]
    R = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                  [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                  [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
    return R, np.array(record["position"])


def degrees_of(R: np.ndarray) -> float:
    """Returns the angle of a rotation."""
    return math.degrees(math.acos(min(1.0, max(-1.0, (np.trace(R) - 1) / 2))))


def apart(found: dict, true: dict) -> tuple[float, float]:
    """Returns the distance between two poses, millimetres and degrees."""
    (R, t), (S, u) = pose(found), pose(true)
    return 1e3 * float(np.linalg.norm(t - u)), degrees_of(R.T @ S)


def latency_row(what: str, figure: str, latency: dict, true: float) -> Row:
    return Row(what, figure, 1e3 * abs(latency["seconds"] - true), 2.0, "ms", "ground truth")


def mounting_rows(what: str, tracker: dict, truth: dict) -> Iterator[Row]:
    """Yields the errors of sensor_from_scene_camera and world_from_transmitter."""
    for key, true, name in (("sensor_from_scene_camera", "T_sensor_cam", "camera on sensor"),
                            ("world_from_transmitter", "T_world_source", "transmitter in world")):
        mm, degrees = apart(tracker[key], truth[true])
        yield Row(what, f"{name}, position", mm, 1.0, "mm", "ground truth")
        yield Row(what, f"{name}, rotation", degrees, 0.1, "degrees", "ground truth")


# ----------------------------------------------------------------------------- path-traced rigs (--simulated)


def waved(j: Judge) -> Iterator[Row]:
    """Latency and mounting, then verification of the rig with these calibrations."""
    for session in j.simulated("waved"):
        truth, work = truth_of(session)["tracker"], j.folder(session.name)
        mcap = j.imported(work, session)
        (work / "rig/calibration").mkdir()
        made = session / "made.json"
        metal = made.exists() and json.loads(made.read_text())["metal"] > 0
        latency = j.calibrate(work, "latency", "rig/calibration/latency.json", "--session", mcap)["tracker_minus_scene"]
        yield latency_row(session.name, "latency", latency, truth["latency_s"])
        tracker = j.calibrate(work, "tracker", "rig/calibration/tracker.json", "--session", mcap, *(["--distortion"] if metal else []))
        if not metal:
            yield from mounting_rows(session.name, tracker, truth)
        j.run(work, "import", work / "rig", work / "whole.mcap", "--force")
        check = j.calibrate(work, "verify", "check.json", "--session", work / "whole.mcap")
        distorted = ", distorted tracker field" if metal else ""
        yield Row(session.name, f"markers by the tracker alone{distorted}", check["reprojection_px"], 1.0, "px RMS", "markers")
        latency = latency_without_markers(j, work)
        yield latency_row(session.name, f"latency by {latency['by']}, mounting known", latency, truth["latency_s"])


def latency_without_markers(j: Judge, work: Path) -> dict:
    """Calibrates the latency again with known mounting and without tags."""
    rig = work / "unmarked"
    shutil.copytree(work / "rig", rig)
    (rig / "calibration/latency.json").unlink()
    known = json.loads((rig / "rig.json").read_text())
    known.pop("markers")
    (rig / "rig.json").write_text(json.dumps(known))
    j.run(work, "import", rig, "unmarked.mcap", "--force")
    return j.calibrate(work, "latency", "unmarked-latency.json", "--session", "unmarked.mcap")["tracker_minus_scene"]


def tag_map(j: Judge) -> Iterator[Row]:
    """Relative poses of the tags. One tag is behind a box in every picture and may be missing."""
    for session in j.simulated("waved"):
        work = j.folder(f"{session.name}-map")
        true = {m["id"]: pose(m["T_world_marker"]) for m in json.loads((session / "rig.json").read_text())["markers"]}
        found = found_map(j, work, session)
        (R0, t0), (F0, f0) = true[0], found[0]
        millimetres, degrees = [], []
        for number in found:
            (R, t), (F, f) = true[number], found[number]
            millimetres.append(1e3 * float(np.linalg.norm(R0.T @ (t - t0) - F0.T @ (f - f0))))
            degrees.append(degrees_of((R0.T @ R).T @ (F0.T @ F)))
        what = f"{session.name}, {len(found)} of {len(true)} tags"
        yield Row(what, "tags missing from the map", len(true) - len(found), 1, "tags", "one is hidden")
        yield Row(what, "map, worst position", max(millimetres), 1.0, "mm", "ground truth")
        yield Row(what, "map, worst rotation", max(degrees), 0.5, "degrees", "ground truth")


def found_map(j: Judge, work: Path, session: Path) -> dict[int, Pose]:
    """Returns the map that the program calibrates if rig.json lists no tags."""
    view = blind_view(session, work / "rig")
    rig = json.loads((view / "rig.json").read_text())
    size = rig.pop("markers")[0]["size_m"]
    (view / "rig.json").write_text(json.dumps(rig))
    j.run(work, "import", view, "session.mcap", "--force")
    found = j.calibrate(work, "map", "markers.json", "--session", "session.mcap", "--size", size, "--origin", 0)
    return {m["id"]: pose(m["pose"]) for m in found["markers"]}


def environment(j: Judge) -> Iterator[Row]:
    """Environment camera calibration by tags; the pose in rig.json has an error of five degrees."""
    for session in j.simulated("fisheye"):
        work = j.folder(session.name)
        found = j.calibrate(work, "environment", "environment.json", "--session", j.imported(work, session))
        mm, degrees = apart(found["T_world_cam"], truth_of(session)["environment_camera"]["T_world_cam"])
        yield Row(session.name, f"environment camera's rotation by {found['by']}", degrees, 0.5, "degrees", "ground truth")
        yield Row(session.name, f"its position by {found['by']}", mm, 10.0, "mm", "ground truth")


# ----------------------------------------------------------------------------- registration


class Replayed:
    """Compares a replay's camera poses with the true ones by the errors of the corners of a box around the object, pixels."""

    def __init__(self, j: Judge, work: Path, session: Path, registration: str, scene_camera: dict, box: np.ndarray, true_pose: Callable[[float], Pose], predict: str = "picture") -> None:
        self.K = np.array(scene_camera["K"])
        lens = scene_camera["lens_distortion"]
        self.distortion = np.array([lens[k] for k in ("k1", "k2", "p1", "p2", "k3")] if isinstance(lens, dict) else lens)
        self.box, self.true_pose = np.array(box), true_pose
        (work / "c.toml").write_text(f'[registration]\npose = "{registration}"\npredict = "{predict}"\n')
        j.run(work, "replay", session, "--config", "c.toml", "--headless", "--listen", "127.0.0.1:0", "--speed", "max", "--poses-out", "poses.csv")
        self.rows = [row for row in csv.DictReader((work / "poses.csv").open()) if row["x"]]

    def pixels(self, p: Pose) -> np.ndarray:
        return cv2.projectPoints((self.box - p[1]) @ p[0], np.zeros(3), np.zeros(3), self.K, self.distortion)[0][:, 0]

    def off(self, row: dict, prefix: str, nanos: float) -> np.ndarray:
        """Returns the distances between the box's corners by the pose of a row (`prefix` "" or "shown_") and by the true pose."""
        q = [float(row[prefix + k]) for k in ("qw", "qx", "qy", "qz")]
        used = pose({"quaternion_wxyz": q, "position": [float(row[prefix + k]) for k in "xyz"]})
        return np.linalg.norm(self.pixels(used) - self.pixels(self.true_pose(nanos)), axis=1)

    def when_captured(self) -> float:
        return rms([self.off(row, "", float(row["captured_ns"])) for row in self.rows])

    def when_shown(self, what: str, registration: str, until: float) -> Iterator[Row]:
        """Yields the errors of the object at the time of display; the ground truth ends at `until`, nanoseconds."""
        rows = [row for row in self.rows if row["shown_x"] and row["shown_sigma_px"] and float(row["shown_ns"]) <= until]
        predicted = rms([self.off(row, "shown_", float(row["shown_ns"])) for row in rows])
        unpredicted = rms([self.off(row, "", float(row["shown_ns"])) for row in rows])
        reported = rms([float(row["shown_sigma_px"]) for row in rows]) * math.sqrt(2)
        ahead = 1e-6 * float(np.median([float(row["shown_ns"]) - float(row["captured_ns"]) for row in rows]))
        yield Row(what, f"object by {registration} displayed {ahead:.0f} ms later, {len(rows)} pictures", predicted, 0.5 * unpredicted, "px RMS", f"ground truth; half the error without prediction ({unpredicted:.2f})")
        yield Row(what, "that error, relative to the reported one", predicted / reported, 1.25, "times", f"ground truth ({reported:.2f} px reported)")


def rms(values: list) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def true_poses(session: Path) -> Callable[[float], Pose]:
    """Returns the poses of camera_truth.csv as a function of capture time, nanoseconds."""
    table = np.loadtxt(session / "camera_truth.csv", delimiter=",", skiprows=1)
    times, positions, rotations = table[:, 0], table[:, 1:4], table[:, 4:8]
    rotations = rotations * np.where(np.cumprod(np.r_[1, np.sign((rotations[1:] * rotations[:-1]).sum(1))]) < 0, -1, 1)[:, None]

    def at(ns: float) -> Pose:
        # Rows are 8 ms apart: the error of linear interpolation is below a hundredth of a millimetre.
        q = np.array([np.interp(ns, times, rotations[:, k]) for k in range(4)])
        position = np.array([np.interp(ns, times, positions[:, k]) for k in range(3)])
        return pose({"quaternion_wxyz": q / np.linalg.norm(q), "position": position})

    return at


#: Corners of the object's bounding box, world, metres.
BOX = np.array([[x, y, z] for x in (-0.07, 0.07) for y in (-0.07, 0.07) for z in (0, 0.11)])


def registration(j: Judge) -> Iterator[Row]:
    """Position of the composed object in each picture of the path-traced rigs, which `waved` has calibrated."""
    for session in j.simulated("waved"):
        truth, whole = truth_of(session), j.a.out / session.name / "whole.mcap"
        if not whole.exists():
            raise Skipped("no calibrated rigs; run the part `tracker` before")
        R, t = pose(truth["object"]["T_world_object"])
        replay = lambda how, work, *predict: Replayed(j, j.folder(work), whole, how, truth["scene_camera"], BOX @ R.T + t, true_poses(session), *predict)
        for how in ("tracker", "markers", "hybrid"):
            found = replay(how, f"{session.name}-{how}")
            yield Row(session.name, f"object by {how}, {len(found.rows)} pictures", found.when_captured(), 1.0, "px RMS", "ground truth")
        for how in ("markers", "hybrid"):
            yield from replay(how, f"{session.name}-{how}-display", "display").when_shown(session.name, how, np.inf)


# ----------------------------------------------------------------------------- rigs simulated by the program

#: Options of `simulate session` by seed.
SIMULATED = {
    1: [],
    2: ["--gaps", "0.03", "--jumps", "0.005", "--blur", "1.0"],
    3: ["--motion", "slow", "--camera-latency", "0.021", "--tracker-latency", "0.006", "--noise", "4"],
}


def simulated(j: Judge) -> Iterator[Row]:
    """Rigs of `simulate session`: latency and mounting, then the object with known calibration."""
    for seed, options in SIMULATED.items():
        what, work = " ".join([f"simulated rig {seed}", *options]), j.folder(f"simulated-{seed}")

        def make(name: str, seconds: int, *more: str) -> dict:
            j.run(work, "simulate", "session", "--seed", seed, "--seconds", seconds, *options, *more, "--out", f"{name}.mcap", "--truth", f"{name}.json")
            return json.loads((work / f"{name}.json").read_text())

        truth = make("blind", 12, "--known-markers")
        true_offset = truth["tracker_latency_s"] - truth["scene_camera_latency_s"]
        latency = j.calibrate(work, "latency", "latency.json", "--session", "blind.mcap")["tracker_minus_scene"]
        yield latency_row(what, f"latency by {latency['by']}", latency, true_offset)
        yield from mounting_rows(what, j.calibrate(work, "tracker", "tracker.json", "--session", "blind.mcap"), truth)
        # Slow motion is too small for the optical flow.
        if "slow" not in options:
            make("unmarked", 20)
            latency = j.calibrate(work, "latency", "unmarked-latency.json", "--session", "unmarked.mcap")["tracker_minus_scene"]
            yield latency_row(what, f"latency by {latency['by']}", latency, true_offset)
        yield from simulated_registration(j, what, seed, work / "known.mcap", make("known", 12, "--known-markers", "--known-tracker"))


def simulated_registration(j: Judge, what: str, seed: int, session: Path, truth: dict) -> Iterator[Row]:
    last = float(truth["frames"][-1]["capture_ns"])
    for how in ("tracker", "hybrid"):
        found = Replayed(j, j.folder(f"simulated-{seed}-{how}"), session, how, truth["scene_camera"], BOX, simulated_poses(truth), "display")
        yield Row(what, f"object by {how}, {len(found.rows)} pictures", found.when_captured(), 1.0, "px RMS", "ground truth")
        yield from found.when_shown(what, how, last)


def simulated_poses(truth: dict) -> Callable[[float], Pose]:
    """Returns the true pose of a simulated rig at a time, nanoseconds: a cubic through the poses of four pictures."""
    frames = [(f["capture_ns"], *pose(f["T_world_cam"])) for f in truth["frames"]]
    times = np.array([f[0] for f in frames], float)

    def at(ns: float) -> Pose:
        first = int(np.clip(np.searchsorted(times, ns) - 2, 0, len(times) - 4))
        t = times[first:first + 4]
        weight = [np.prod([(ns - t[b]) / (t[a] - t[b]) for b in range(4) if b != a]) for a in range(4)]
        left, _, right = np.linalg.svd(sum(w * frames[first + a][1] for a, w in enumerate(weight)))
        return left @ right, sum(w * frames[first + a][2] for a, w in enumerate(weight))

    return at

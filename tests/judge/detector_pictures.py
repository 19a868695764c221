"""Pictures of tags for the comparison of detectors: path-traced, synthetic, photographed."""
from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration_judge import Judge, pictures_in, present
from detectors import DICTIONARIES, Found
from synthetic_pictures import picture_of_tags

SYNTHETIC_PICTURES = 40


@dataclass
class Series:
    """Pictures with tags of one family; the tags of each picture, or None if they are unknown."""

    name: str
    family: str
    files: list[Path]
    there: list[Found] | None
    #: Whether the corners of `there` are ground truth; else they only identify the tags.
    exact: bool = False
    synthetic: bool = False


def desk_marker(j: Judge) -> Series:
    """Path-traced pictures with three tags; their corners follow from the true poses of camera and tags."""
    folder = present(j.a.truth / "desk-marker/truth_rig.json").parent
    rig = json.loads((folder / "rig.json").read_text())
    frames = json.loads((folder / "truth_rig.json").read_text())["scene_camera"]["frames_truth"]
    matrix = lambda pose: np.array(pose["matrix_row_major"])
    K, there = np.array(rig["scene_camera"]["K"]), []
    for frame in frames:
        camera_from_world = np.linalg.inv(matrix(frame["T_world_cam"]))
        tags = []
        for marker in rig["markers"]:
            half = marker["size_m"] / 2
            square = np.array([[-half, -half, 0, 1], [half, -half, 0, 1], [half, half, 0, 1], [-half, half, 0, 1]])
            seen = (K @ (camera_from_world @ matrix(marker["T_world_marker"]) @ square.T)[:3]).T
            tags.append((marker["id"], seen[:, :2] / seen[:, 2:]))
        there.append(tags)
    return Series("desk-marker (path-traced)", "tag36h11", pictures_in(folder / "scene", "*.jpg"), there, exact=True)


def synthetic(family: str) -> Callable[[Judge], Series]:
    """Synthetic pictures, whose corners are known."""

    def make(j: Judge) -> Series:
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[family])
        folder, files, there = j.folder(f"synthetic-{family}"), [], []
        for k in range(SYNTHETIC_PICTURES):
            picture, corners = picture_of_tags(dictionary, [k, DICTIONARIES[family]])
            files.append(folder / f"{k:02}.png")
            cv2.imwrite(str(files[-1]), picture)
            there.append(list(corners.items()))
        return Series(f"synthetic {family}", family, files, there, exact=True, synthetic=True)

    return make


def duckietown(j: Judge) -> Series:
    folder = j.data("calibration/apriltag_duckietown")
    files = [folder / "test_image.png", *pictures_in(folder, "test_image_multiple_*.png")]
    return Series("photographs, duckietown", "tag36h11", files, None)


def nasa(j: Judge) -> Series:
    """Many small tags; the text files hold the corners that the AprilTag library's authors expect."""
    files, there = pictures_in(j.data("calibration/apriltag_nasa"), "*.jpg"), []
    for file in files:
        lines = [line for line in file.with_suffix(".txt").read_text().splitlines() if line.strip()]
        numbers = [[float(n) for n in re.findall(r"[-\d.]+", line)] for line in lines]
        there.append([(int(n[0]), np.array(n[1:9]).reshape(4, 2) - 0.5) for n in numbers])
    return Series("photographs, nasa (tags that its authors marked)", "tag36h11", files, there)


def aruco(j: Judge) -> Series:
    file = j.data("calibration/aruco_photos/expected_corners.json")
    expected = {name: tags for name, tags in json.loads(file.read_text()).items() if name.endswith(".jpg")}
    there = [[(int(n), np.array(c, float).reshape(4, 2)) for n, c in tags.items()] for tags in expected.values()]
    return Series("photographs, OpenCV's ArUco (tags of its test)", "6x6_250", [file.with_name(name) for name in expected], there)


def fdcl(j: Judge) -> Series:
    return Series("photograph 1920×1080, aruco_fdcl", "aruco_original", [j.data("calibration/aruco_fdcl/test_image.png")], None)


SERIES: list[tuple[str, Callable[[Judge], Series]]] = [
    ("desk-marker", desk_marker),
    *((f"synthetic {family}", synthetic(family)) for family in ("tag36h11", "tag25h9", "tag16h5", "4x4_50", "6x6_250")),
    ("duckietown", duckietown),
    ("nasa", nasa),
    ("OpenCV's ArUco photographs", aruco),
    ("aruco_fdcl", fdcl),
]

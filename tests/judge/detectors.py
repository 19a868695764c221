"""Tag detectors of other programs behind one interface: from a grey picture to tag numbers and corners.

Corners are returned in Penumbra's convention, pixel (0, 0) centred on the top left pixel. The AprilTag library,
kornia (a port of it) and locus put that pixel's centre at (0.5, 0.5). So does OpenCV's refinement
"AprilTag", unlike the rest of OpenCV. This half pixel is subtracted here. The order of the corners does not
matter to the comparison.
"""
from __future__ import annotations

import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

#: Detected tags: number and four corners, pixels.
Found = list[tuple[int, np.ndarray]]
Detect = Callable[[np.ndarray], Found]

#: Penumbra's name of a family -> OpenCV's dictionary.
DICTIONARIES = {
    "tag36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "tag25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "tag16h5": cv2.aruco.DICT_APRILTAG_16h5,
    "4x4_50": cv2.aruco.DICT_4X4_50,
    "6x6_250": cv2.aruco.DICT_6X6_250,
    "aruco_original": cv2.aruco.DICT_ARUCO_ORIGINAL,
}


@dataclass
class Detector:
    """A detector of another program; `make` returns None for a family that it does not support."""

    name: str
    #: Origin of its quadrilateral detection; detectors of the same origin do not confirm one another.
    origin: str
    #: None for OpenCV, which has several packages.
    package: str | None
    make: Callable[[str], Detect | None]

    def title(self) -> str:
        """Returns name and version; raises PackageNotFoundError if it is not installed."""
        return self.name.format(importlib.metadata.version(self.package) if self.package else cv2.__version__)


def apriltag_library(family: str) -> Detect | None:
    """The AprilTag library (C), full resolution, one thread."""
    import apriltag
    if not family.startswith("tag"):
        return None
    detector = apriltag.apriltag(family, threads=1, decimate=1.0)
    return lambda grey: [(tag["id"], tag["lb-rb-rt-lt"] - 0.5) for tag in detector.detect(grey)]


def kornia(family: str) -> Detect | None:
    """kornia's port of the AprilTag library to Rust, full resolution."""
    import kornia_rs.apriltag as module
    from kornia_rs.image import ImageSize
    names = {"tag36h11": "tag36_h11", "tag25h9": "tag25_h9", "tag16h5": "tag16_h5"}
    if family not in names:
        return None
    config = module.DecodeTagsConfig([module.TagFamilyKind(names[family])])
    config.downscale_factor = 1
    decoders: dict[tuple, object] = {}

    def detect(grey: np.ndarray) -> Found:
        height, width = grey.shape
        if (width, height) not in decoders:
            decoders[width, height] = module.AprilTagDecoder(config, ImageSize(width, height))
        decoder = decoders[width, height]
        found = [(int(tag.id), np.array(tag.quad.corners) - 0.5) for tag in decoder.decode(grey[:, :, None])]
        decoder.clear()
        return found

    return detect


def locus_tag(family: str) -> Detect | None:
    """locus (Rust), its profile "standard", full resolution, one thread."""
    import locus
    names = {"tag36h11": "AprilTag36h11", "tag16h5": "AprilTag16h5", "4x4_50": "ArUco4x4_50", "6x6_250": "ArUco6x6_250"}
    if family not in names:
        return None
    detector = locus.Detector(families=[getattr(locus.TagFamily, names[family])], threads=1, decimation=1)

    def detect(grey: np.ndarray) -> Found:
        batch = detector.detect(grey)
        return [(int(number), np.array(corners) - 0.5) for number, corners in zip(batch.ids, batch.corners)]

    return detect


def opencv(refinement: int, shift: float = 0.0) -> Callable[[str], Detect]:
    """OpenCV's ArUco module with one of its refinements of corners."""

    def make(family: str) -> Detect:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = refinement
        detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARIES[family]), parameters)

        def detect(grey: np.ndarray) -> Found:
            corners, numbers, _ = detector.detectMarkers(grey)
            return [] if numbers is None else [(int(n), c[0] - shift) for n, c in zip(numbers.ravel(), corners)]

        return detect

    return make


DETECTORS = [
    Detector("AprilTag library {}", "AprilTag", "apriltag-python", apriltag_library),
    Detector("kornia {}", "AprilTag", "kornia-rs", kornia),
    Detector("locus {}", "locus", "locus-tag", locus_tag),
    Detector("OpenCV {}, unrefined", "OpenCV", None, opencv(cv2.aruco.CORNER_REFINE_NONE)),
    Detector("OpenCV {}, cornerSubPix", "OpenCV", None, opencv(cv2.aruco.CORNER_REFINE_SUBPIX)),
    Detector("OpenCV {}, AprilTag", "OpenCV", None, opencv(cv2.aruco.CORNER_REFINE_APRILTAG, 0.5)),
]

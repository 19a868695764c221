"""Compares Penumbra's lens calibrations with published ones, the ground truth, and OpenCV's on the same pictures."""
from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration_judge import Comparison, Judge, Row, Skipped, copied, pictures_in, truth_of
from synthetic_pictures import BLACK, BOARD_LENS, WHITE, Lens, Sheet, pictures_of_board

#: Half widths of `cornerSubPix`'s window; OpenCV uses the one with the smallest reprojection error.
WINDOWS = (4, 5, 6, 7, 8, 9, 11)
#: Termination criteria of OpenCV's iterations.
SUBPIX = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)


@dataclass
class Pictures:
    """Pictures of one board by one camera, and the known properties of the lens."""

    name: str
    board: str
    files: list[Path]
    fisheye: bool = False
    #: fx of a published calibration (pixels), and its source.
    published: tuple[float, str] | None = None
    #: Ground truth of synthetic pictures: pixels of the board's corners in each.
    corners: list[np.ndarray] | None = None
    charuco: object = None


@dataclass
class View:
    """Corners of one picture: positions on the board (metres, z = 0), pixels."""

    file: str
    places: np.ndarray
    pixels: np.ndarray


@dataclass
class Found:
    """A lens calibration and its observations."""

    by: str
    views: list[View]
    rms: float
    K: np.ndarray
    #: None for a fisheye.
    distortion: np.ndarray | None = None
    rejected: str = ""
    #: Maximum uncertainty over the picture as reported by Penumbra, pixels.
    sigma: float = float("nan")


# ----------------------------------------------------------------------------- OpenCV


def chessboard_corners(files: list[Path], text: str) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Returns (file, grey picture, positions, unrefined corners) of the pictures in which OpenCV finds a chessboard."""
    columns, rows = map(int, text.split(":")[1].split("x"))
    places = np.zeros((columns * rows, 3), np.float32)
    places[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2) * float(text.split(":")[2])
    seen = []
    for file in files:
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        found, corners = cv2.findChessboardCorners(grey, (columns, rows))
        if found:
            seen.append((file.name, grey, places, corners.astype(np.float32)))
    return seen


def opencv_views(pictures: Pictures) -> Iterator[tuple[str, list[View]]]:
    """Yields OpenCV's corners: for a chessboard once per window of `cornerSubPix`, for a ChArUco board as detected."""
    if pictures.charuco is None:
        seen = chessboard_corners(pictures.files, pictures.board)
        for half in WINDOWS:
            refined = [cv2.cornerSubPix(grey, corners.copy(), (half, half), (-1, -1), SUBPIX) for _, grey, _, corners in seen]
            yield f"own corners, window ±{half}", [View(name, places, c.reshape(-1, 2)) for (name, _, places, _), c in zip(seen, refined)]
        return
    detector, views = cv2.aruco.CharucoDetector(pictures.charuco), []
    for file in pictures.files:
        corners, numbers, *_ = detector.detectBoard(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))
        if numbers is not None and len(numbers) >= 6:
            places = pictures.charuco.getChessboardCorners()[np.ravel(numbers)]
            views.append(View(file.name, places, corners.reshape(-1, 2)))
    yield "own corners", views


def opencv_lens(by: str, views: list[View], size: tuple[int, int], fisheye: bool) -> Found:
    """Calibrates by OpenCV with five coefficients (fisheye: four)."""
    objects = [v.places.astype(np.float32) for v in views]
    pixels = [v.pixels.astype(np.float32)[:, None] for v in views]
    if fisheye:
        # OpenCV 5 has moved the flags to another module.
        flags = sum(getattr(cv2.fisheye, n, None) or getattr(cv2, n) for n in ("CALIB_USE_INTRINSIC_GUESS", "CALIB_RECOMPUTE_EXTRINSIC", "CALIB_FIX_SKEW"))
        K = np.array([[size[0] / 3, 0, size[0] / 2], [0, size[0] / 3, size[1] / 2], [0, 0, 1]])
        rms, K, *_ = cv2.fisheye.calibrate([o[None].astype(float) for o in objects], [p.reshape(1, -1, 2).astype(float) for p in pixels], size, K, np.zeros((4, 1)), flags=flags, criteria=(3, 100, 1e-9))
        return Found(by, views, float(rms), K)
    rms, K, distortion, *_ = cv2.calibrateCamera(objects, pixels, size, np.eye(3), np.zeros(5))
    return Found(by, views, float(rms), K, distortion.ravel()[:5])


def size_of(pictures: Pictures) -> tuple[int, int]:
    return cv2.imread(str(pictures.files[0]), cv2.IMREAD_GRAYSCALE).shape[::-1]


def by_opencv(pictures: Pictures) -> Found:
    """Returns OpenCV's calibration with the smallest reprojection error from its own corners."""
    tried = [opencv_lens(f"OpenCV {cv2.__version__}, {how}", views, size_of(pictures), pictures.fisheye) for how, views in opencv_views(pictures)]
    return min(tried, key=lambda found: found.rms)


# ----------------------------------------------------------------------------- Penumbra


def by_penumbra(j: Judge, pictures: Pictures) -> Found:
    work = j.folder("lens-" + pictures.name.replace(" ", "-").replace(",", ""))
    extra = ["--model", "fisheye", "--free-aspect"] if pictures.fisheye else []
    lens = j.calibrate(work, "intrinsics", "lens.json", "--pictures", copied(work, pictures.files), "--board", pictures.board, "--corners", "corners.csv", *extra)
    quality, seen = lens["quality"], {}
    for row in csv.DictReader((work / "corners.csv").open()):
        seen.setdefault(row["view"], []).append([float(row[k]) for k in ("board_x_m", "board_y_m", "pixel_x", "pixel_y")])
    views = [View(name, np.pad(np.array(rows)[:, :2], ((0, 0), (0, 1))), np.array(rows)[:, 2:]) for name, rows in seen.items()]
    used, there = quality["corners"]
    out = f"; {there - used} rejected" if there > used else ""
    return Found("**Penumbra**", views, quality["rms"], *matrices(lens), out, quality["projection_sigma"][1])


NAMES = ("k1", "k2", "p1", "p2", "k3")


def matrices(lens: dict) -> tuple[np.ndarray, np.ndarray | None]:
    """Returns camera matrix and distortion of a calibration file."""
    K = np.array([[lens["focal"][0], 0, lens["centre"][0]], [0, lens["focal"][1], lens["centre"][1]], [0, 0, 1]])
    return K, np.array([lens["distortion"].get(n, 0.0) for n in NAMES]) if lens["model"] == "brown" else None


# ----------------------------------------------------------------------------- pictures


def published_focal(file: Path, matrix: str) -> float:
    """Returns fx of a camera matrix in an OpenCV file; cv2 cannot read files of its first versions."""
    after = file.read_text().partition(f"{matrix}:")[2].partition("data: [")[2]
    return float(after.split(",")[0])


def photographed(j: Judge, side: str) -> Pictures:
    """OpenCV's own photographs of a chessboard."""
    folder = j.data("calibration/opencv_stereo_chess")
    file, matrix, by = {
        "left": ("left_intrinsics.yml", "camera_matrix", "published"),
        "right": ("intrinsics.yml", "M2", "published, one focal length for both cameras"),
    }[side]
    published = published_focal(folder / file, matrix), by
    return Pictures(f"chessboard, {side}", "chess:9x6:0.025", pictures_in(folder, f"{side}[0-9]*.jpg"), published=published)


def fisheye(j: Judge) -> Pictures:
    files = pictures_in(j.data("probes-fisheye/fisheye/ocam_fisheye1"), "Fisheye1_*.jpg")
    return Pictures("fisheye chessboard", "chess:8x6:0.0325", files, fisheye=True)


#: OpenCV's older order of markers differs where the number of rows is even.
SQUARE, COLUMNS, ROWS = 0.03, 10, 8
VIEWS = 14


def synthetic(j: Judge, kind: str) -> Pictures:
    """A board of 10 by 8 squares in 14 poses, rendered with a known lens."""
    name, charuco, per_square = f"synthetic {kind}", None, 8
    if kind == "chessboard":
        bits, text = np.kron(np.indices((ROWS, COLUMNS)).sum(0) % 2, np.ones((per_square, per_square))), f"chess:{COLUMNS - 1}x{ROWS - 1}:{SQUARE}"
    else:
        # A marker has 6 of a square's 8 cells.
        marker = 0.75 * SQUARE
        charuco = cv2.aruco.CharucoBoard((COLUMNS, ROWS), SQUARE, marker, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
        charuco.setLegacyPattern("older" in kind)
        bits, text = charuco.generateImage((COLUMNS * per_square, ROWS * per_square)) > 127, f"charuco:{COLUMNS}x{ROWS}:{SQUARE}:{marker}:4x4_50"
    cell = SQUARE / per_square
    margin = per_square // 2
    cells = np.where(np.pad(bits, margin, constant_values=1) > 0, WHITE, BLACK)
    sheet = Sheet(cells, cell, (-margin * cell,) * 2)
    points = np.array([[SQUARE * (x + 1), SQUARE * (y + 1), 0] for y in range(ROWS - 1) for x in range(COLUMNS - 1)])
    folder, files, corners = j.folder(name.replace(" ", "-")), [], []
    for k, (picture, seen) in enumerate(pictures_of_board(sheet, points, VIEWS, seed=11)):
        files.append(folder / f"{k:02}.png")
        cv2.imwrite(str(files[-1]), picture)
        corners.append(seen)
    return Pictures(name, text, files, corners=corners, charuco=charuco)


SETS = {
    "chessboard, left": lambda j: photographed(j, "left"),
    "chessboard, right": lambda j: photographed(j, "right"),
    "fisheye chessboard": fisheye,
    "synthetic chessboard": lambda j: synthetic(j, "chessboard"),
    "synthetic ChArUco": lambda j: synthetic(j, "ChArUco"),
    "synthetic ChArUco, OpenCV's older order": lambda j: synthetic(j, "ChArUco, OpenCV's older order"),
}


# ----------------------------------------------------------------------------- evaluation


def corner_error(pictures: Pictures, views: list[View]) -> float | None:
    """Returns the RMS distance of detected corners from the nearest true ones, pixels; None for photographs."""
    if pictures.corners is None:
        return None
    true = {file.name: corners for file, corners in zip(pictures.files, pictures.corners)}
    off = [np.linalg.norm(v.pixels[:, None] - true[v.file][None], axis=2).min(1) for v in views]
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))


def lens_error(found: Lens, true: Lens) -> float:
    """Returns the distance in pixels between the projections of the same directions, 95th percentile over the picture.

    The rotation of the camera that minimises it is removed first, because boards cannot determine it.
    """
    width, height = true.size
    u, v = np.meshgrid(np.linspace(0, width - 1, 33), np.linspace(0, height - 1, 25))
    pixels = np.stack([u.ravel(), v.ravel()], -1)
    rays = lambda lens: np.pad(lens.rays(pixels), ((0, 0), (0, 1)), constant_values=1)
    unit = lambda p: p / np.linalg.norm(p, axis=1)[:, None]
    theirs, there = unit(rays(found)), unit(rays(true))
    left, _, right = np.linalg.svd(theirs.T @ there)
    rotation = (left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right).T
    seen = true.pixels(theirs @ rotation.T, np.eye(3), np.zeros(3))
    return float(np.percentile(np.linalg.norm(seen - pixels, axis=1), 95))


def synthetic_lens_error(pictures: Pictures, found: Found) -> float | None:
    """Returns the lens error for synthetic pictures; None for photographs, whose lens is unknown."""
    if pictures.corners is None or found.distortion is None:
        return None
    return lens_error(Lens(BOARD_LENS.size, found.K, found.distortion), BOARD_LENS)


def line(pictures: Pictures, found: Found, known: str) -> list[str]:
    corners = sum(len(v.pixels) for v in found.views)
    errors = [corner_error(pictures, found.views), synthetic_lens_error(pictures, found)]
    return [pictures.name, found.by, str(len(found.views)), f"{corners}{found.rejected}", *("–" if e is None else f"{e:.3f}" for e in errors),
            f"{found.rms:.3f}", f"{found.K[0, 0]:.1f}", known]


def known_focal(pictures: Pictures) -> tuple[float, str] | None:
    return (float(BOARD_LENS.K[0, 0]), "ground truth") if pictures.corners is not None else pictures.published


def lenses(j: Judge) -> Iterator[Row | Comparison]:
    """Compares Penumbra's lenses with OpenCV's, from OpenCV's corners and from Penumbra's."""
    header = ["pictures", "by", "views", "corners", "corner error, px RMS", "lens error, px", "reprojection, px RMS", "f, px", "f published or true"]
    table = Comparison("lenses", "Lenses", header)
    for name, make in SETS.items():
        try:
            pictures = make(j)
        except Skipped as reason:
            j.skip(f"lens of {name}", reason)
            continue
        ours, theirs = by_penumbra(j, pictures), by_opencv(pictures)
        both = opencv_lens(f"OpenCV {cv2.__version__}, Penumbra's corners", ours.views, size_of(pictures), pictures.fisheye)
        known = known_focal(pictures)
        table.lines += [line(pictures, found, f"{known[0]:.1f} ({known[1]})" if known else "–") for found in (ours, theirs, both)]
        yield from bars(pictures, ours, theirs, known)
    table.remarks = [REMARKS]
    if table.lines:
        yield table


def bars(pictures: Pictures, ours: Found, theirs: Found, known: tuple[float, str] | None) -> Iterator[Row]:
    """Yields the limits: synthetic pictures are compared with the ground truth, photographs by their reprojection error."""
    if pictures.corners is None:
        yield Row(pictures.name, "reprojection", ours.rms, theirs.rms, "px RMS", f"{theirs.by}, on the same pictures")
    else:
        error, allowed = corner_error(pictures, ours.views), corner_error(pictures, theirs.views)
        yield Row(pictures.name, "corners", error, allowed, "px RMS", f"{theirs.by}, on the same pictures")
        yield Row(pictures.name, "whole lens", synthetic_lens_error(pictures, ours), 3 * ours.sigma, "px, 95th percentile", "ground truth; 3σ reported by the program")
    if known:
        yield Row(pictures.name, "focal length", 100 * abs(ours.K[0, 0] / known[0] - 1), 0.5, "%", known[1])


def simulated_lens(j: Judge) -> Iterator[Row]:
    """Path-traced rigs with a board (--simulated)."""
    for session in j.simulated("board"):
        truth = truth_of(session)["scene_camera"]
        work = j.folder(session.name)
        board = json.loads((session / "board.json").read_text())["board"]
        lens = j.calibrate(work, "intrinsics", "lens.json", "--session", j.imported(work, session), "--board", board)
        size = tuple(lens["image_size"])
        true = Lens(size, np.array(truth["K"]), np.array([truth["lens_distortion"].get(n, 0.0) for n in NAMES]))
        found = Lens(size, *matrices(lens))
        off = 100 * max(abs(found.K[k, k] / true.K[k, k] - 1) for k in (0, 1))
        yield Row(f"{session.name} ({board})", "focal length", off, 0.5, "%", "ground truth")
        # The error must be within three standard deviations as reported by the program.
        allowed = 3 * lens["quality"]["projection_sigma"][1]
        yield Row(f"{session.name} ({board})", "whole lens", lens_error(found, true), allowed, "px, 95th percentile", "ground truth; 3σ reported by the program")


REMARKS = (
    "OpenCV: `findChessboardCorners`, `cornerSubPix` with the window that leaves the smallest error, or `CharucoDetector`; "
    "`calibrateCamera` with five coefficients, `fisheye.calibrate` with four and no skew; no outliers are rejected. "
    "Penumbra uses one focal length for both axes except for the fisheye. Errors of corners and of the lens (95th percentile over the picture, `lens_error`) are those of synthetic pictures, whose lens is known. "
    "A smaller reprojection error alone does not mean a better lens: rejecting more corners reduces it."
)

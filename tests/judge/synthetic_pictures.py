"""Renders pictures of tags and boards whose corners are known exactly.

Linear radiance is integrated over each pixel (jittered samples), blurred by a Gaussian point spread function and
encoded as sRGB; then Gaussian noise is added to the codes. Pixel (0, 0) is the centre of the top left pixel.
"""
from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

#: Reflectance of printed paper.
BLACK, WHITE = 0.04, 0.85
#: Samples along each side of a pixel.
SAMPLES = 6


@dataclass
class Lens:
    """A pinhole camera with Brown's distortion: k1, k2, p1, p2, k3 (Brown 1966, OpenCV's order)."""

    size: tuple[int, int]
    K: np.ndarray
    distortion: np.ndarray

    def pixels(self, points: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Projects points of a board's frame (metres) to pixels."""
        seen, _ = cv2.projectPoints(points.astype(float), cv2.Rodrigues(R)[0], t, self.K, self.distortion)
        return seen[:, 0]

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Returns the viewing directions of pixels, z = 1, by fixed-point iteration on the distortion."""
        seen = (pixels - self.K[:2, 2]) / self.K[[0, 1], [0, 1]]
        if not self.distortion.any():
            return seen
        k1, k2, p1, p2, k3 = self.distortion
        found = seen
        for _ in range(20):
            x, y = found[..., 0], found[..., 1]
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            tangential = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], -1)
            found = (seen - tangential) / radial[..., None]
        return found


@dataclass
class Sheet:
    """A flat print: reflectance of its cells, the side of a cell, and the first cell's corner on the print (metres)."""

    cells: np.ndarray
    cell: float
    corner: tuple[float, float]

    def outline(self) -> np.ndarray:
        rows, columns = self.cells.shape
        x, y = self.corner
        return np.array([[x + i * columns * self.cell, y + j * rows * self.cell, 0] for i in (0, 1) for j in (0, 1)])

    def at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the reflectance at positions on the print, and whether they are on it."""
        column, row = np.floor((places - self.corner) / self.cell).astype(int).transpose(-1, *range(places.ndim - 1))
        rows, columns = self.cells.shape
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        return self.cells[row.clip(0, rows - 1), column.clip(0, columns - 1)], inside


class Photograph:
    """Renders a picture: reflectance, then light, blur and noise."""

    def __init__(self, lens: Lens, rng: np.random.Generator) -> None:
        self.lens, self.rng = lens, rng
        self.light = clutter(lens.size, rng)

    def draw(self, sheet: Sheet, R: np.ndarray, t: np.ndarray) -> None:
        """Renders a print; `R`, `t` transform its frame to the camera's."""
        width, height = self.lens.size
        seen = self.lens.pixels(sheet.outline(), R, t)
        # A distorted edge may exceed the bounding box of the corners.
        margin = 3 + (40 if self.lens.distortion.any() else 0)
        (x0, y0), (x1, y1) = np.floor(seen.min(0)).astype(int) - margin, np.ceil(seen.max(0)).astype(int) + margin
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, width - 1), min(y1, height - 1)
        if x0 > x1 or y0 > y1:
            return
        u, v = np.meshgrid(np.arange(x0, x1 + 1), np.arange(y0, y1 + 1))
        pixels = np.stack([u, v], -1)
        # Within a pixel the projection is approximated as linear.
        middle = self.lens.rays(pixels)
        right, down = (self.lens.rays(pixels + step) - middle for step in ([1, 0], [0, 1]))
        total, cover = np.zeros(u.shape), np.zeros(u.shape)
        plane_from_ray = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t]))
        for i in range(SAMPLES):
            for j in range(SAMPLES):
                jitter = (np.array([i, j]) + self.rng.uniform(0, 1, (*u.shape, 2))) / SAMPLES - 0.5
                rays = middle + jitter[..., :1] * right + jitter[..., 1:] * down
                place = np.pad(rays, ((0, 0), (0, 0), (0, 1)), constant_values=1) @ plane_from_ray.T
                reflectance, inside = sheet.at(place[..., :2] / place[..., 2:])
                inside &= place[..., 2] > 0
                total += np.where(inside, reflectance, 0)
                cover += inside
        region = self.light[y0:y1 + 1, x0:x1 + 1]
        region *= 1 - cover / SAMPLES**2
        region += total / SAMPLES**2

    def developed(self, blur: float, noise: float) -> np.ndarray:
        """Returns the picture's codes with uneven light, a Gaussian point spread function (`blur`, pixels), sRGB and noise (codes)."""
        width, height = self.lens.size
        u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
        slope = self.rng.uniform(-0.25, 0.25, 2)
        light = self.light * self.rng.uniform(0.5, 0.95) * (1 + slope[0] * u + slope[1] * v)
        linear = cv2.GaussianBlur(light, (0, 0), blur).clip(0, 1)
        code = 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        return (code + self.rng.normal(0, noise, code.shape)).round().clip(0, 255).astype(np.uint8)


def clutter(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Returns a background of smooth shades and sharp polygons, linear."""
    width, height = size
    picture = cv2.resize(rng.uniform(0.1, 0.6, (6, 8)), size, interpolation=cv2.INTER_CUBIC)
    for _ in range(25):
        centre = rng.uniform(0, 1, 2) * size
        around = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 6)))
        reach = rng.uniform(6, 60)
        corners = centre + reach * np.stack([np.cos(around), np.sin(around)], -1)
        cv2.fillPoly(picture, [corners.round().astype(np.int32)], float(rng.uniform(0.03, 0.8)))
    return picture


def posed(rng: np.random.Generator, tilt: float) -> np.ndarray:
    """Returns a random rotation: any roll, the normal tilted by up to `tilt` radians from the viewing direction."""
    roll, towards, angle = rng.uniform(-np.pi, np.pi), rng.uniform(-np.pi, np.pi), rng.uniform(0, tilt)
    tilted = cv2.Rodrigues(angle * np.array([np.cos(towards), np.sin(towards), 0]))[0]
    return tilted @ cv2.Rodrigues(np.array([0, 0, roll]))[0]


def tag_sheet(dictionary: object, number: int) -> Sheet:
    """A tag with a side of 1 m, its middle at the origin, on a white margin one module wide."""
    modules = dictionary.markerSize + 2
    bits = cv2.aruco.generateImageMarker(dictionary, number, modules) > 127
    cells = np.where(np.pad(bits, 1, constant_values=True), WHITE, BLACK)
    return Sheet(cells, 1 / modules, (-0.5 - 1 / modules,) * 2)


#: Corners of a tag with a side of 1 m.
TAG_CORNERS = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])


def picture_of_tags(dictionary: object, seed: list[int], size: tuple[int, int] = (640, 480)) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Six tags with sides of 16 to 120 pixels, tilted by up to 60 degrees; returns the picture, and corners by number."""
    rng = np.random.default_rng(seed)
    width, height = size
    K = np.array([[600.0, 0, (width - 1) / 2], [0, 600.0, (height - 1) / 2], [0, 0, 1]])
    lens, corners = Lens(size, K, np.zeros(5)), {}
    photograph = Photograph(lens, rng)
    for k, number in enumerate(rng.choice(dictionary.bytesList.shape[0], 6, replace=False)):
        side = float(np.exp(rng.uniform(np.log(16), np.log(120))))
        middle = np.array([(k % 3 + 0.5) * width / 3, (k // 3 + 0.5) * height / 2]) + rng.uniform(-15, 15, 2)
        distance = K[0, 0] / side
        t = distance * np.array([*(middle - K[:2, 2]) / K[0, 0], 1])
        R = posed(rng, np.radians(60))
        photograph.draw(tag_sheet(dictionary, int(number)), R, t)
        corners[int(number)] = lens.pixels(TAG_CORNERS, R, t)
    return photograph.developed(blur=float(rng.uniform(0.3, 0.9)), noise=2.0), corners


#: The camera of the pictures of boards.
BOARD_LENS = Lens((640, 480), np.array([[560.0, 0, 324.3], [0, 560.0, 236.8], [0, 0, 1]]), np.array([-0.25, 0.08, 0.0008, -0.0005, 0.0]))


def pictures_of_board(sheet: Sheet, points: np.ndarray, count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Renders a board in `count` poses with all its points visible; returns pictures and the pixels of the points (metres, z = 0)."""
    rng, lens, found = np.random.default_rng(seed), BOARD_LENS, []
    middle = np.append((points.max(0) + points.min(0))[:2] / 2, 0)
    extent = np.ptp(points[:, :2], axis=0).max()
    while len(found) < count:
        R = posed(rng, np.radians(45))
        distance = lens.K[0, 0] * extent / rng.uniform(280, 480)
        aside = rng.uniform(-120, 120, 2) / lens.K[0, 0]
        t = distance * np.array([*aside, 1]) - R @ middle
        seen = lens.pixels(points, R, t)
        if (seen < 12).any() or (seen > np.array(lens.size) - 13).any():
            continue
        photograph = Photograph(lens, rng)
        photograph.draw(sheet, R, t)
        found.append((photograph.developed(blur=float(rng.uniform(0.4, 0.8)), noise=2.0), seen))
    return found

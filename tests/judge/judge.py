#!/usr/bin/env python3
"""Compare composited pictures with path-traced ground truth.

    tests/judge/judge.py RIG                     figures of the baselines
    tests/judge/judge.py RIG --pictures DIR      and of the pictures in DIR

RIG is a folder with, for every judged frame number N of five digits,

    truth/with_N, truth/without_N    the scene with and without the virtual object, without noise
    masks/object_N                   share of each pixel that the virtual object covers, 255 = all
    masks/labels_without_N           what each pixel shows without the object; see RECEIVERS
    masks/object_open_N              optional: the object's share if no unknown object hid it
    scene/N                          optional: the camera's picture, with noise

The last digits in the name of a file in DIR are its frame number. All pictures are 8-bit sRGB.
Every figure is zero for a picture that equals the ground truth.
"""
from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from colour import ciede2000, lab_from_srgb, linear_from_srgb, luminance, srgb_from_linear

#: Column -> its meaning. Luminance is linear, relative to the ground truth without the object.
FIGURES = {
    "rmse_shadow": "root mean square error in the shadow, 8-bit codes",
    "s_err": "mean absolute luminance error in the shadow",
    "s_bias": "error of the summed luminance of the shadow; positive: too bright",
    "s_core": "the same for the darkest quarter of the shadow",
    "dE": "mean CIEDE2000 in the shadow",
    "l_err": "mean absolute luminance error where the object or a virtual light brightens the scene",
    "dE_lit": "mean CIEDE2000 there",
    "dE_object": "mean CIEDE2000 on the virtual object",
    "bad": "percentage of the changed pixels whose CIEDE2000 is above 6, a clearly visible difference",
}
#: Labels of real surfaces that can show a shadow: the ground (1) and real objects. Lights, the mirrored
#: sphere, the sky (0) and the virtual object are outside this range.
RECEIVERS = range(1, 90)
#: A pixel lies in the shadow (or is lit) if its luminance falls (or rises) by this share ...
LUMINANCE_CHANGE = 0.02
#: ... and a channel changes by this many 8-bit codes. Smaller changes are noise of the path tracer.
CODE_CHANGE = 2
#: Minimum number of lit pixels for their figures.
LIT_PIXELS = 200
VISIBLE_DIFFERENCE = 6.0
#: Minimum luminance of a divisor.
DARK = 1e-4


class Unjudged(Exception):
    """Pictures or ground truth are missing or do not match; the message names them."""


@dataclass(frozen=True)
class Truth:
    """Ground truth of one frame; pictures in sRGB, masks of pixels."""

    with_object: np.ndarray
    without: np.ndarray
    coverage: np.ndarray
    shadow: np.ndarray
    core: np.ndarray
    lit: np.ndarray
    object: np.ndarray
    changed: np.ndarray
    #: The camera's picture, if the folder has it.
    noisy: np.ndarray | None


def grown(mask: np.ndarray, pixels: int = 1) -> np.ndarray:
    """Dilates the mask by a number of pixels, diagonals included."""
    for _ in range(pixels):
        around = np.pad(mask, 1)
        around = around[:-2] | around[1:-1] | around[2:]
        mask = around[:, :-2] | around[:, 1:-1] | around[:, 2:]
    return mask


def picture_file(folder: Path, stem: str) -> Path | None:
    """Returns the picture of that name in any format."""
    return next(iter(sorted(folder.glob(f"{stem}.*"))), None)


def read(file: Path | None, mode: str, what: str) -> np.ndarray:
    """Reads the 8-bit codes of a picture."""
    if file is None:
        raise Unjudged(f"{what} is missing")
    with Image.open(file) as picture:
        return np.asarray(picture.convert(mode))


def read_srgb(file: Path | None, what: str) -> np.ndarray:
    return read(file, "RGB", what) / 255.0


def frame_numbers(rig: Path, every: int = 1) -> list[int]:
    """Returns the numbers of every N-th frame with ground truth."""
    return sorted(number(file) for file in (rig / "truth").glob("with_*"))[::every]


def number(file: Path) -> int:
    """Returns the last number in a file's name."""
    return int(re.findall(r"\d+", file.stem)[-1])


def load_truth(rig: Path, frame: int) -> Truth:
    """Reads the ground truth of one frame and determines its regions."""
    def pixels(folder: str, name: str) -> np.ndarray:
        return read(picture_file(rig / folder, f"{name}_{frame:05d}"), "L", f"{rig}/{folder}/{name}_{frame:05d}")

    with_object, without = (
        read_srgb(picture_file(rig / "truth", f"{name}_{frame:05d}"), f"{rig}/truth/{name}_{frame:05d}") for name in ("with", "without"))
    coverage, labels = pixels("masks", "object") / 255.0, pixels("masks", "labels_without")
    scene = picture_file(rig / "scene", f"{frame:05d}")
    receiver = (labels >= RECEIVERS.start) & (labels < RECEIVERS.stop) & ~grown(coverage > 0)
    ratio = luminance(with_object) / np.maximum(luminance(without), DARK)
    altered = receiver & (np.abs(with_object - without).max(-1) * 255 >= CODE_CHANGE)
    shadow, lit = altered & (ratio <= 1 - LUMINANCE_CHANGE), altered & (ratio >= 1 + LUMINANCE_CHANGE)
    darkest = np.quantile(ratio[shadow], 0.25) if shadow.any() else 0.0
    hidden = np.zeros_like(shadow)
    if picture_file(rig / "masks", f"object_open_{frame:05d}"):
        hidden = (pixels("masks", "object_open") / 255.0 > 0.5) & (coverage < 0.05)
    return Truth(with_object, without, coverage, shadow, shadow & (ratio <= darkest), lit, coverage > 0.99,
                 changed_pixels(shadow | lit, coverage, hidden, with_object), read_srgb(scene, "") if scene else None)


def changed_pixels(receivers: np.ndarray, coverage: np.ndarray, hidden: np.ndarray, with_object: np.ndarray) -> np.ndarray:
    """Returns the pixels that the object changes: itself, its shadow and light, two pixels around, and its occluders.

    The inside of the teapot's open spout is left out. Its surface has one side only, so it is black in
    the truth, which is no fault of a picture that shows it otherwise.
    """
    black = (coverage > 0) & (with_object.max(-1) < 4 / 255)
    return (grown(receivers | (coverage > 0), 2) | hidden) & ~grown(black)


def figures(truth: Truth, picture: np.ndarray) -> dict[str, float]:
    """Returns the figures of one picture (sRGB); figures of empty regions are omitted."""
    found: dict[str, float] = {}
    luma, want, base = luminance(picture), luminance(truth.with_object), luminance(truth.without)
    relative = np.abs(luma - want) / np.maximum(base, DARK)
    difference = difference_map(truth, picture)
    if truth.shadow.any():
        squares = (picture - truth.with_object)[truth.shadow] ** 2
        found["rmse_shadow"] = 255 * math.sqrt(squares.mean())
        found["s_err"] = relative[truth.shadow].mean()
        for column, region in (("s_bias", truth.shadow), ("s_core", truth.core)):
            found[column] = (luma - want)[region].sum() / base[region].sum()
        found["dE"] = difference[truth.shadow].mean()
    if truth.lit.sum() > LIT_PIXELS:
        found["l_err"], found["dE_lit"] = relative[truth.lit].mean(), difference[truth.lit].mean()
    if truth.object.any():
        found["dE_object"] = difference[truth.object].mean()
    if truth.changed.any():
        found["bad"] = 100 * (difference[truth.changed] > VISIBLE_DIFFERENCE).mean()
    return {column: float(value) for column, value in found.items()}


def difference_map(truth: Truth, picture: np.ndarray) -> np.ndarray:
    """Returns CIEDE2000 between picture and ground truth in every region, 0 elsewhere."""
    region = truth.shadow | truth.lit | truth.object | truth.changed
    difference = np.zeros(region.shape)
    difference[region] = ciede2000(lab_from_srgb(picture[region]), lab_from_srgb(truth.with_object[region]))
    return difference


def baselines(truth: Truth) -> dict[str, np.ndarray]:
    """Returns pictures made from the ground truth, as a scale for the figures.

    without     neither object nor shadow
    unlit_mean  the object in its true mean colour, no shadow
    blob        the true object over a shadow that is equally dark everywhere
    truth_jpg   the truth with the camera's noise and JPEG errors: the best that a program can reach
    """
    linear, base = linear_from_srgb(truth.with_object), linear_from_srgb(truth.without)
    coverage, covered = truth.coverage[..., None], truth.coverage[..., None] > 0
    made = {"without": truth.without}
    if truth.object.any():
        made["unlit_mean"] = srgb_from_linear(coverage * linear[truth.object].mean(0) + (1 - coverage) * base)
    if truth.shadow.any():
        mean = linear[truth.shadow].sum(0) / base[truth.shadow].sum(0)
        darkened = srgb_from_linear(np.where(truth.shadow[..., None], base * mean, base))
        made["blob"] = np.where(covered, truth.with_object, darkened)
    if truth.noisy is not None:
        differs = np.abs(truth.with_object - truth.without).max(-1, keepdims=True) * 255 >= 1
        shaded = srgb_from_linear(linear_from_srgb(truth.noisy) * linear / np.maximum(base, DARK))
        made["truth_jpg"] = np.where(covered, truth.with_object, np.where(differs, shaded, truth.noisy))
    return {name: np.round(np.clip(picture, 0, 1) * 255) / 255 for name, picture in made.items()}


def overall(rows: list[dict[str, float]]) -> dict[str, float]:
    """Combines the figures of frames: the root mean square of RMSE, the mean of the others."""
    result = {}
    for column in FIGURES:
        values = np.array([row[column] for row in rows if column in row])
        if len(values):
            result[column] = float(np.sqrt(np.mean(values**2)) if column.startswith("rmse") else values.mean())
    return result


def judge_pictures(rig: Path, pictures: Path, every: int = 1, least: float = 1.0) -> dict[str, float]:
    """Returns the figures of a folder of pictures, which must contain at least this share of the evaluated frames."""
    there = {number(file): file for file in sorted(pictures.glob("*.*")) if re.search(r"\d", file.stem)}
    wanted = list(frames(rig, every))
    found = [frame for frame in wanted if frame in there]
    if least < 1 and len(found) >= least * len(wanted):
        wanted = found
    return overall([judge_picture(load_truth(rig, frame), there.get(frame), f"{pictures}: frame {frame}") for frame in wanted])


def judge_picture(truth: Truth, file: Path | None, what: str) -> dict[str, float]:
    """Returns the figures of one file."""
    picture = read_srgb(file, what)
    if picture.shape != truth.with_object.shape:
        raise Unjudged(f"{file}: {picture.shape[1]}x{picture.shape[0]} pixels; the truth has {truth.without.shape[1]}x{truth.without.shape[0]}")
    return figures(truth, picture)


def judge_baselines(rig: Path, every: int = 1) -> dict[str, dict[str, float]]:
    """Returns the figures of the baselines, by name."""
    rows: dict[str, list[dict[str, float]]] = {}
    for frame in frames(rig, every):
        truth = load_truth(rig, frame)
        for name, picture in baselines(truth).items():
            rows.setdefault(name, []).append(figures(truth, picture))
    return {name: overall(each) for name, each in rows.items()}


def frames(rig: Path, every: int) -> Iterator[int]:
    """Returns the numbers of the evaluated frames; raises Unjudged if there are none."""
    found = frame_numbers(rig, every)
    if not found:
        raise Unjudged(f"{rig}/truth has no pictures with_*")
    yield from found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rig", type=Path)
    parser.add_argument("--pictures", type=Path, help="folder of composited pictures")
    parser.add_argument("--every", type=int, default=1, help="evaluate every N-th frame with ground truth")
    a = parser.parse_args()
    try:
        rows = judge_baselines(a.rig, a.every)
        if a.pictures:
            rows = {"pictures": judge_pictures(a.rig, a.pictures, a.every), **rows}
    except (Unjudged, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{'':12}" + "".join(f"{column:>13}" for column in FIGURES))
    for name, row in rows.items():
        print(f"{name:12}" + "".join(f"{row[column]:13.4f}" if column in row else f"{'-':>13}" for column in FIGURES))
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Does the picture hold still where the rig and its light do, and does light change as smoothly as in the truth?

    pump     standard deviation over time of a region's mean luminance, percent of its mean: the cameras' noise averages out over
             thousands of pixels, and what is left is the program's own unsteadiness
    step     largest change of that mean from one picture to the next, percent
    shimmer  median over pixels of the standard deviation over time, divided by that of a perfect composite of the same pictures
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

from colour import linear_from_srgb, luminance, srgb_from_linear
from judge import frame_numbers, load_truth, number, picture_file, read_srgb

#: Pictures at the beginning that are left out, because filters may settle.
SKIPPED = 10
#: Pictures that a rig needs.
NEEDED = 20


def is_still(rig: Path) -> bool:
    """Whether nothing moves: the truth of its first picture stands for many."""
    return frame_numbers(rig) == [0] and len(list((rig / "scene").glob("*.*"))) >= NEEDED


def steadiness(rig: Path, pictures: Path) -> dict[str, float]:
    """Returns pump, step and shimmer of the shadow and of the object, of a folder of pictures of a still rig."""
    truth = load_truth(rig, 0)
    ratio = linear_from_srgb(truth.with_object) / np.maximum(linear_from_srgb(truth.without), 1e-4)
    changed = np.abs(truth.with_object - truth.without).max(-1, keepdims=True) * 255 >= 1
    covered = truth.coverage[..., None] > 0
    regions = {"shadow": truth.shadow, "object": truth.object}
    series: dict[tuple[str, bool], list[np.ndarray]] = {(name, perfect): [] for name in regions for perfect in (False, True)}
    for file in sorted(pictures.glob("*.png"), key=number):
        camera = picture_file(rig / "scene", f"{number(file):05d}")
        if number(file) < SKIPPED or camera is None:
            continue
        noisy = read_srgb(camera, str(camera))
        relit = np.where(changed, srgb_from_linear(linear_from_srgb(noisy) * ratio), noisy)
        ideal = np.round(np.where(covered, truth.with_object, relit).clip(0, 1) * 255) / 255
        for (name, perfect), values in series.items():
            values.append(luminance(ideal if perfect else read_srgb(file, str(file)))[regions[name]])
    found = {}
    for name in regions:
        ours, ideal = (np.array(series[name, perfect]) for perfect in (False, True))
        if len(ours) < NEEDED - SKIPPED or not ours.size:
            continue
        means = ours.mean(1)
        found |= {
            f"pump {name} %": 100 * means.std() / means.mean(),
            f"step {name} %": 100 * np.abs(np.diff(means)).max() / means.mean(),
        }
        noise = np.median(ideal.std(0))
        if noise > 1e-5:
            found[f"shimmer {name}"] = np.median(ours.std(0)) / noise
    return {figure: float(value) for figure, value in found.items()}


def largest_changes(rig: Path, pictures: Path) -> tuple[float, float]:
    """Returns the largest change of the object's mean luminance from one true picture to the next, percent of its mean: in the
    pictures, and in the truth. Only pixels that the object covers in both count."""
    numbers, ours, wanted = frame_numbers(rig), [], []
    there = {number(file): file for file in pictures.glob("*.png")}
    for before, after in zip(numbers, numbers[1:]):
        truths = load_truth(rig, before), load_truth(rig, after)
        both = truths[0].object & truths[1].object
        if not both.any() or before not in there or after not in there:
            continue

        def change(pair: list[np.ndarray]) -> float:
            first, second = (luminance(picture)[both].mean() for picture in pair)
            return 100 * abs(second - first) / first
        ours.append(change([read_srgb(there[k], str(k)) for k in (before, after)]))
        wanted.append(change([truth.with_object for truth in truths]))
    return max(ours, default=0.0), max(wanted, default=0.0)

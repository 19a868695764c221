"""Compares Penumbra's tag detector with others on the same pictures: tags found, corner error, time.

The pictures are those of detector_pictures.py: `desk-marker` (--truth), synthetic pictures, photographs (--data).
If the tags of a picture are known, Penumbra must find as many as the best other detector. Synthetic pictures hold tags
that are too small for any detector; there it must find every tag with modules at least LEGIBLE wide. If corners are
known exactly, its corner error must not exceed that of the best other detector.
"""
from __future__ import annotations

import csv
import importlib.metadata
import os
import re
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from calibration_judge import Comparison, Judge, Row, Skipped, copied
from detector_pictures import SERIES, Series
from detectors import DETECTORS, DICTIONARIES, Found

#: Number of times that each picture is processed; the shortest time counts.
ROUNDS = 3
PENUMBRA = "**Penumbra**"
#: Minimum width of a module, pixels, from which Penumbra must find every synthetic tag. Chosen from the tags that it
#: misses: of 1,800 tags, only two large slanted ones with modules from 2.4 px upwards. The table counts narrower tags, too.
LEGIBLE = 2.5


@dataclass
class Outcome:
    """Tags that one detector found in each picture of a series, and its median time, milliseconds."""

    found: list[Found]
    millis: float | None


# ----------------------------------------------------------------------------- detecting


def by_penumbra(j: Judge, series: Series) -> Outcome:
    """Runs `penumbra calibrate tags` on several copies of each picture and takes the shortest time of each."""
    work = j.folder("detect-" + re.sub(r"\W+", "-", series.name))
    output = j.run(work, "calibrate", "tags", "--pictures", copied(work, series.files, ROUNDS), "--family", series.family, "--out", "tags.csv")
    found: dict[str, Found] = {f"{file.stem}~0{file.suffix}": [] for file in series.files}
    for row in csv.DictReader((work / "tags.csv").open()):
        if row["picture"] in found:
            corners = np.array([[float(row[f"{axis}{k}"]) for axis in "xy"] for k in range(4)])
            found[row["picture"]].append((int(row["id"]), corners))
    best: dict[str, float] = {}
    for stem, millis in re.findall(r"^(.+)~\d+\.\w+: \d+ tags in ([\d.]+) ms$", output, re.M):
        best[stem] = min(best.get(stem, 1e9), float(millis))
    return Outcome(list(found.values()), statistics.median(best.values()) if best else None)


def by_other(detect: Callable[[np.ndarray], Found], series: Series) -> Outcome:
    found, times = [], []
    for file in series.files:
        grey, shortest = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.inf
        for _ in range(ROUNDS):
            begun = time.perf_counter()
            tags = detect(grey)
            shortest = min(shortest, time.perf_counter() - begun)
        found.append([(number, np.asarray(corners, float).reshape(4, 2)) for number, corners in tags])
        times.append(1e3 * shortest)
    return Outcome(found, statistics.median(times))


# ----------------------------------------------------------------------------- evaluation


def nearest_order(found: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Returns the corners in the cyclic order, starting at any corner and in either direction, that fits best."""
    orders = [np.roll(way, k, 0) for way in (found, found[::-1]) for k in range(4)]
    return min(orders, key=lambda order: float(np.sum((order - there) ** 2)))


def module_width(family: str, corners: np.ndarray) -> float:
    """Returns the width of a module in the direction in which the tag is narrowest, pixels."""
    longest = np.linalg.norm(corners - np.roll(corners, -1, 0), axis=1).max()
    modules = cv2.aruco.getPredefinedDictionary(DICTIONARIES[family]).markerSize + 2
    return float(cv2.contourArea(corners.astype(np.float32)) / longest / modules)


def same_place(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.linalg.norm(a.mean(0) - b.mean(0)) < 4)


def matched(found: list[Found], there: list[Found]) -> tuple[dict[tuple[int, int], np.ndarray], int]:
    """Returns the corner offsets (pixels) of each tag found, by picture and list index; and the number of false detections."""
    offsets, strange = {}, 0
    for picture, (seen, tags) in enumerate(zip(found, there)):
        for number, corners in seen:
            known = [k for k, (n, c) in enumerate(tags) if n == number and same_place(c, corners)]
            # A second detection of the same tag is a false detection.
            if not known or (picture, known[0]) in offsets:
                strange += 1
                continue
            offsets[picture, known[0]] = nearest_order(corners, tags[known[0]][1]) - tags[known[0]][1]
    return offsets, strange


def agreed(outcomes: dict[str, tuple[str, Outcome]], pictures: int) -> list[Found]:
    """For pictures without known tags: returns the tags that detectors of at least two origins find at the same position."""
    there: list[Found] = []
    for picture in range(pictures):
        groups: list[tuple[int, np.ndarray, set[str]]] = []
        for origin, outcome in outcomes.values():
            for number, corners in outcome.found[picture]:
                group = next((g for g in groups if g[0] == number and same_place(g[1], corners)), None)
                if group:
                    group[2].add(origin)
                else:
                    groups.append((number, corners, {origin}))
        there.append([(number, corners) for number, corners, origins in groups if len(origins) > 1])
    return there


def rms(offsets: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.sum(np.concatenate(offsets) ** 2, axis=1)))) if offsets else float("nan")


def available(j: Judge) -> list[tuple[str, object]]:
    """Returns (title, detector) of the installed detectors."""
    found = []
    for detector in DETECTORS:
        try:
            title = detector.title()
            detector.make("tag36h11")
            found.append((title, detector))
        except (ImportError, importlib.metadata.PackageNotFoundError):
            j.skip(f"detector {detector.package}", "not installed; pip install -r tests/judge/requirements-detectors.txt")
    return found


def evaluated(series: Series, outcomes: dict[str, tuple[str, Outcome]]) -> tuple[list[list[str]], Iterator[Row]]:
    """Returns the table rows of a series, and the limits if the ground truth is known."""
    there = series.there if series.there is not None else agreed(outcomes, len(series.files))
    total = sum(map(len, there))
    results = {title: matched(outcome.found, there) for title, (_, outcome) in outcomes.items()}
    shared = set.intersection(*(set(offsets) for offsets, _ in results.values()))
    lines, errors = [], {}
    for title, (offsets, strange) in results.items():
        common = [offsets[k] for k in shared]
        errors[title] = rms(common)
        worst = max((float(np.linalg.norm(o, axis=1).max()) for o in offsets.values()), default=float("nan"))
        exact = [f"{errors[title]:.3f}", f"{rms(list(offsets.values())):.3f}", f"{worst:.2f}"] if series.exact else ["–"] * 3
        millis = outcomes[title][1].millis
        lines.append([series.name, title, f"{len(offsets)} of {total}", str(strange), *exact, "–" if millis is None else f"{millis:.1f}"])
    return lines, bars(series, results, errors, total)


def bars(series: Series, results: dict, errors: dict[str, float], total: int) -> Iterator[Row]:
    """Yields the limits of a series whose tags are known; see the docstring of this file."""
    others, what = [title for title in results if title != PENUMBRA], f"{series.name}, {total} tags"
    if series.there is None or not others:
        return
    most = max(others, key=lambda title: len(results[title][0]))
    ours, theirs = results[PENUMBRA][0], results[most][0]
    if series.synthetic:
        legible = [(picture, k) for picture, tags in enumerate(series.there) for k, (_, corners) in enumerate(tags) if module_width(series.family, corners) >= LEGIBLE]
        yield Row(f"{series.name}, {len(legible)} tags", f"not found of those with modules from {LEGIBLE} px", sum(k not in ours for k in legible), 0, "tags", "ground truth")
    else:
        yield Row(what, "tags not found", total - len(ours), total - len(theirs), "tags", most)
    if series.exact:
        nearest = min(others, key=lambda title: errors[title])
        yield Row(what, "corner error of tags found by all", errors[PENUMBRA], errors[nearest], "px RMS", nearest)
    else:
        # The authors' corners are rounded to pixels.
        yield Row(what, "corners", rms(list(ours.values())), 1.0, "px RMS", "as marked by its authors")


def detectors(j: Judge) -> Iterator[Row | Comparison]:
    """Yields the limits and the comparison; series without data are reported as skipped."""
    cv2.setNumThreads(1)
    # kornia reads this when it starts its threads.
    os.environ["RAYON_NUM_THREADS"] = "1"
    header = ["pictures", "detector", "tags found", "false detections", "corner error, tags found by all, px RMS", "all tags found", "max", "ms per picture"]
    table = Comparison("detectors", "Tag detectors", header)
    others, untimed = available(j), False
    for name, make in SERIES:
        try:
            series = make(j)
        except Skipped as reason:
            j.skip(f"detectors on {name}", reason)
            continue
        outcomes = {PENUMBRA: ("Penumbra", by_penumbra(j, series))}
        untimed |= outcomes[PENUMBRA][1].millis is None
        for title, detector in others:
            if detect := detector.make(series.family):
                outcomes[title] = (detector.origin, by_other(detect, series))
        lines, rows = evaluated(series, outcomes)
        table.lines += lines
        yield from rows
    if untimed:
        j.skip("Penumbra's time for a picture", "`penumbra calibrate tags` of this build does not print it")
    table.remarks = [REMARKS]
    if table.lines:
        yield table


def board_plane(j: Judge) -> Iterator[Row]:
    """A photograph of a flat board: deviation of the corners from a plane, at most that of OpenCV's best refinement."""
    file = j.data("calibration/aruco_photos/chocclusion_original.jpg")
    series = Series("chocclusion_original.jpg", "6x6_250", [file], None)
    board = cv2.aruco.CharucoBoard((5, 7), 0.04, 0.02, cv2.aruco.getPredefinedDictionary(DICTIONARIES[series.family]))
    places = {int(n): np.array(corners)[:, :2].astype(float) for n, corners in zip(np.ravel(board.getIds()), board.getObjPoints())}
    found = {PENUMBRA: by_penumbra(j, series)} | {
        detector.title(): by_other(detector.make(series.family), series) for detector in DETECTORS if detector.origin == "OpenCV"}
    markers = {title: dict(outcome.found[0]) for title, outcome in found.items()}
    shared = sorted(set(places).intersection(*markers.values()))

    def off_plane(seen: dict[int, np.ndarray]) -> float:
        there, pixels = (np.concatenate([which[n] for n in shared]) for which in (places, seen))
        H, _ = cv2.findHomography(there, pixels, 0)
        return rms([cv2.perspectiveTransform(there[None], H)[0] - pixels])

    off = {title: off_plane(seen) for title, seen in markers.items()}
    best = min((title for title in off if title != PENUMBRA), key=lambda title: off[title])
    yield Row(f"{series.name}, {len(shared)} markers", "corners, deviation from the board's plane", off[PENUMBRA], off[best], "px RMS", best)


def grids(j: Judge) -> Iterator[Row]:
    """Photographs of Kalibr's boards from two published data sets; the other detectors do not support their wider border."""
    for name, path in (("EuRoC", "calibration/aprilgrid/EuRoC.png"), ("TUM VI, fisheye", "probes-fisheye/fisheye/tumvi_aprilgrid/TUM_VI.png")):
        try:
            series = Series(f"AprilGrid of {name}", "kalibr36h11", [j.data(path)], None)
        except Skipped as reason:
            j.skip(f"AprilGrid of {name}", reason)
            continue
        on_board = {number for number, _ in by_penumbra(j, series).found[0] if number < 36}
        yield Row(series.name, "not found of 36", 36 - len(on_board), 0, "tags", "the board")


REMARKS = (
    "Time of detection only, with the grey picture in memory, one thread; median over the pictures of the shortest of "
    f"{ROUNDS} rounds. No decimation; all other settings are defaults. False detections match no known tag "
    "(in photographs without known tags: no detector of another origin confirms them; in nasa's they include real tags that its authors did not mark). "
    "Synthetic tags have sides of 16 to 120 px and are tilted by up to 60°; they are rendered in linear light, blurred (0.3 to 0.9 px) and encoded as sRGB, where black squares look smaller than they are: "
    "edges that are fitted to codes are displaced inwards. "
    f"The limit for synthetic tags applies to modules from {LEGIBLE} px; the counts include narrower ones. "
    "The AprilTag library, kornia, locus and OpenCV's refinement \"AprilTag\" have half a pixel subtracted, because their pixel centres are at 0.5."
)

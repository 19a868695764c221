#!/usr/bin/env python3
"""Tests of judge.py, colour.py, fidelity.py, steadiness.py, rigs.py, tables.py, faults.py, soak.py, bench_compare.py and gpu_check.py.

    tests/judge/judge_test.py [-v]

The comparison with ../shared/truth/compare.py, an independent implementation, is SKIPPED if that file is missing.
"""
from __future__ import annotations

import argparse
import csv
import math
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import faults
import fidelity
import gpu_check
from python_env import ROOT, Unavailable, python_with, run_with

try:
    run_with(fidelity.PACKAGES, fidelity.REQUIREMENTS)
except Unavailable as error:
    sys.exit(f"judge_test: {error}")

import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

import bench_compare  # noqa: E402
import bench_table  # noqa: E402
import colour  # noqa: E402
import judge  # noqa: E402
import near_lamps  # noqa: E402
import steadiness  # noqa: E402
import rigs  # noqa: E402
import soak  # noqa: E402
import tables  # noqa: E402

PAIRS = ROOT / "tests/fixtures/ciede2000/pairs.csv"
SHARED = ROOT / "../shared"
COMPARE_PACKAGES = ["numpy", "scipy", "PIL", "skimage"]
COMPARE_REQUIREMENTS = ROOT / "tests/judge/requirements-compare.txt"


class Scratch(unittest.TestCase):
    """A test with a folder of its own."""

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)


class Colour(unittest.TestCase):
    def test_ciede2000_gives_the_published_differences(self) -> None:
        table = np.loadtxt(PAIRS, delimiter=",", skiprows=1)
        self.assertEqual(len(table), 34)
        for first, second in ((table[:, :3], table[:, 3:6]), (table[:, 3:6], table[:, :3])):
            np.testing.assert_allclose(colour.ciede2000(first, second), table[:, 6], atol=5e-5)

    def test_lab_of_white_and_of_the_primaries(self) -> None:
        lab = colour.lab_from_srgb(np.array([[1, 1, 1], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]))
        known = np.array([[100, 0, 0], [0, 0, 0], [53.24, 80.09, 67.20], [87.73, -86.18, 83.18], [32.30, 79.19, -107.86]])
        np.testing.assert_allclose(lab, known, atol=0.02)

    def test_srgb_and_linear_are_inverse(self) -> None:
        codes = np.arange(256) / 255
        np.testing.assert_allclose(colour.srgb_from_linear(colour.linear_from_srgb(codes)), codes, atol=1e-12)


class Figures(Scratch):
    """A grey ground, an object of 10 by 10 pixels, beside it a shadow of 20 by 20 pixels."""

    OBJECT, SHADOW = np.s_[5:15, 5:15], np.s_[30:50, 30:50]

    def setUp(self) -> None:
        super().setUp()
        for name in ("truth", "masks", "pictures"):
            (self.folder / name).mkdir()
        self.without = np.full((64, 64, 3), 200, np.uint8)
        self.with_object = self.without.copy()
        self.with_object[self.SHADOW] = 100
        self.with_object[self.OBJECT] = (180, 40, 30)
        coverage = np.zeros((64, 64), np.uint8)
        coverage[self.OBJECT] = 255
        self.save("truth/with_00007.png", self.with_object)
        self.save("truth/without_00007.png", self.without)
        self.save("masks/object_00007.png", coverage)
        self.save("masks/labels_without_00007.png", np.full((64, 64), 1, np.uint8))

    def save(self, name: str, pixels: np.ndarray) -> None:
        Image.fromarray(pixels).save(self.folder / name)

    def judged(self, picture: np.ndarray) -> dict[str, float]:
        self.save("pictures/out_00007.png", picture)
        return judge.judge_pictures(self.folder, self.folder / "pictures")

    def test_regions(self) -> None:
        truth = judge.load_truth(self.folder, 7)
        self.assertEqual((truth.shadow.sum(), truth.object.sum(), truth.lit.sum()), (400, 100, 0))
        self.assertEqual(truth.changed.sum(), 24 * 24 + 14 * 14)
        self.save("masks/labels_without_00007.png", np.full((64, 64), 200, np.uint8))
        self.assertEqual(judge.load_truth(self.folder, 7).shadow.sum(), 0)

    def test_ground_truth_has_no_error(self) -> None:
        self.assertEqual(set(self.judged(self.with_object).values()), {0.0})

    def test_missing_shadow_is_counted_completely(self) -> None:
        found = self.judged(self.without)
        dark, bright = colour.linear_from_srgb(np.array([100, 200]) / 255)
        for column in ("s_err", "s_bias", "s_core"):
            self.assertAlmostEqual(found[column], 1 - dark / bright)
        self.assertAlmostEqual(found["rmse_shadow"], 100)
        self.assertAlmostEqual(found["bad"], 100 * (400 + 100) / (24 * 24 + 14 * 14))

    def test_too_dark_shadow_has_negative_bias(self) -> None:
        picture = self.with_object.copy()
        picture[self.SHADOW] = 90
        self.assertLess(self.judged(picture)["s_bias"], -0.01)

    def test_missing_light_is_an_error(self) -> None:
        self.with_object[self.SHADOW] = 230
        self.save("truth/with_00007.png", self.with_object)
        found = self.judged(self.without)
        base, lit = colour.linear_from_srgb(np.array([200, 230]) / 255)
        self.assertAlmostEqual(found["l_err"], lit / base - 1)
        self.assertNotIn("s_err", found)

    def test_overall_is_root_mean_square_of_rmse_and_mean_of_others(self) -> None:
        found = judge.overall([{"rmse_shadow": 3.0, "dE": 1.0}, {"rmse_shadow": 4.0}])
        self.assertEqual(found, {"rmse_shadow": math.sqrt(12.5), "dE": 1.0})

    def test_missing_picture_is_refused(self) -> None:
        with self.assertRaisesRegex(judge.Unjudged, "frame 7 is missing"):
            judge.judge_pictures(self.folder, self.folder / "pictures")

    def test_picture_of_another_size_is_refused(self) -> None:
        with self.assertRaisesRegex(judge.Unjudged, "32x16 pixels; the truth has 64x64"):
            self.judged(np.zeros((16, 32, 3), np.uint8))


class Bundled(Scratch):
    def test_ground_truth_belongs_to_the_sessions(self) -> None:
        """The session contains the camera's pictures of the ground truth, byte for byte."""
        for rig in rigs.bundled():
            session = rig.recording.read_bytes()
            for frame in judge.frame_numbers(rig.truth):
                self.assertIn((rig.truth / f"scene/{frame:05d}.jpg").read_bytes(), session, f"{rig.name}, frame {frame}")

    def test_noise_causes_less_error_than_a_missing_shadow(self) -> None:
        for rig in rigs.bundled():
            rows = judge.judge_baselines(rig.truth)
            for column, share in (("s_err", 0.1), ("dE", 0.25), ("bad", 0.01)):
                self.assertLess(rows["truth_jpg"][column], share * rows["without"][column], f"{rig.name}: {column}")

    def test_bundled_rigs_are_found_and_missing_ones_listed(self) -> None:
        found, missing = fidelity.chosen_rigs(argparse.Namespace(truth=[self.folder], sessions=None, every=4))
        self.assertEqual([(rig.name, rig.every) for rig in found], [("courtyard.mcap", 1), ("desk.mcap", 1)])
        self.assertEqual(missing, [*rigs.OUTSIDE])

    def test_blind_view_omits_the_ground_truth(self) -> None:
        for name in ("truth/with_00000.png", "masks/object_00000.png", "scene/00000.jpg", "truth_rig.json", "rig.json"):
            file = self.folder / "rig" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text("")
        view = rigs.blind_view(self.folder / "rig", self.folder / "view")
        self.assertEqual(sorted(p.name for p in view.rglob("*") if p.is_file()), ["00000.jpg", "rig.json"])


class Bars(unittest.TestCase):
    WITHOUT = {"s_err": 0.3, "dE": 10.0}
    GOOD = {"s_err": 0.09, "s_bias": -0.01, "dE": 4.0, "dE_object": 4.0, "bad": 2.0}

    def reached(self, gains: list[float] | None = None, name: str = "desk", **worse: float) -> bool:
        return fidelity.bars_table([fidelity.Result(name, {"image-based-shadowing, best": self.GOOD | worse, "without": self.WITHOUT}, gains)])[1]

    def test_each_limit_can_be_exceeded(self) -> None:
        self.assertTrue(self.reached([1.0, 0.0, -2.0]))
        self.assertFalse(self.reached([0.0, 0.0, -3.1]))
        for column, worse in (("s_err", 0.11), ("s_bias", -0.02), ("s_bias", 0.02), ("dE", 4.6), ("dE_object", 5.1)):
            self.assertFalse(self.reached(**{column: worse}), column)

    def test_live_quality_is_held_to_the_best(self) -> None:
        best = self.GOOD | {"s_err": 0.08}

        def table(**worse: float) -> tuple[str, bool]:
            rows = {"image-based-shadowing, best": best, "image-based-shadowing, live": best | worse, "without": self.WITHOUT}
            return fidelity.bars_table([fidelity.Result("desk", rows, None)])
        text, good = table(bad=2.3)
        self.assertTrue(good, text)
        self.assertEqual(text.count("aim missed"), 1)
        self.assertIn("| desk | bad %, live | 2.3000 | 1.0000 | 2.30 | aim missed |", text)
        for column, worse in (("s_err", 0.095), ("bad", 2.5), ("dE_object", 4.3)):
            self.assertFalse(table(**{column: worse})[1], column)

    def test_virtual_lamps_have_separate_limits(self) -> None:
        self.assertTrue(self.reached(name="desk-lamp", l_err=0.07, dE_lit=2.0))
        for figures in ({"l_err": 0.09, "dE_lit": 2.0}, {"l_err": 0.07, "dE_lit": 3.1}, {}):
            self.assertFalse(self.reached(name="desk-lamp", **figures), figures)


class Faults(unittest.TestCase):
    def test_table_has_a_sum_and_names_what_was_missed(self) -> None:
        row = {"kind": "silence", "place": "tracker", "injections": 3, "named": 3, "recovered": 3, "largest_gap_ms": 80.4, "slowest_recovery_ms": 150.0}
        late = {**row, "place": "scene-camera", "named": 2, "largest_gap_ms": 501.0, "slowest_recovery_ms": 2001.0}
        growth = {"memory_mb": [400.0, 401.0], "threads": [18, 18], "descriptors": [13, 13]}
        results = {"pictures": 1200, "seconds": 90.0, "rows": [row, late], "growth": growth}
        written = faults.table(results, "machine")
        self.assertIn("| silence | scene camera | 3 | 2 | 501 | 3 | 2001 |", written)
        self.assertIn("| all |  | 6 | 5 | 501 | 6 | 2001 |", written)
        self.assertEqual(len(faults.missed(results)), 3)
        self.assertEqual(faults.missed({**results, "rows": [row]}), [])


class Soak(Scratch):
    def test_the_memory_that_fills_caches_does_not_count_and_the_rest_does(self) -> None:
        cold = [(n, 100.0 + n) for n in range(0, 100, 10)]
        flat = soak.fit([*cold, *((n, 200.0) for n in range(100, 1001, 100))], 100)
        self.assertEqual((flat.frames, flat.measured, flat.start_mb, flat.growth_percent), (1000, 900, 200.0, 0.0))
        rising = soak.fit([*cold, *((n, 200 + n / 100) for n in range(100, 1001, 100))], 100)
        self.assertEqual((rising.start_mb, rising.end_mb), (201.0, 210.0))
        with self.assertRaises(SystemExit):
            soak.fit(cold, 100)

    def test_pieces_are_added_up_by_day(self) -> None:
        log = self.folder / "soak.csv"
        pieces = [soak.Piece("2026-11-26", 1000, 900, 200.0, 202.0), soak.Piece("2026-11-26", 3000, 2700, 200.0, 199.0), soak.Piece("2026-11-27", 500, 450, 100.0, 103.0)]
        for piece in pieces:
            soak.append(log, piece)
        self.assertEqual(soak.read(log), pieces)
        rows = soak.summary(soak.read(log)).splitlines()[2:]
        self.assertEqual(rows[0], "| 2026-11-26 | 2 | 4,000 | 3,000 | 200.0 | 200.5 | -0.13 | +0.25 | +1.00 |")
        self.assertEqual(rows[2], "| all | 3 | 4,500 | 3,000 | 200.0 | 199.0 | +0.22 | +1.00 | +3.00 |")


class SpeedAims(unittest.TestCase):
    def test_aims_are_compared_in_their_direction(self) -> None:
        def supan(lights: int, redrawn: int, fps: float) -> dict:
            return {"case": "supan", "planes": 0, "environment": "", "lights": lights, "refreshed_per_frame": redrawn, "fps": fps}

        def rig(p50: float) -> dict:
            times = {"p50": p50, "p99": 40.0}
            return {"width": 640, "lights": 64, "samples": 4, "max_wait_ms": 20, "frames_per_second": 20, "arrival_to_picture_ms": times}
        rows = [supan(8, 1, 40.0), supan(64, 1, 32.0), supan(64, 64, 7.0)]
        lines = bench_table.aims(rows, [rig(19.0)], [("start", 2.5, 2.0)])
        self.assertEqual([line.split(" | ")[-1] for line in lines],
                         ["reached |", "not reached |", "reached |", "not reached |", "not reached |", "not reached |"])
        self.assertIn("| supan, 64 lights as a share of 8 lights | 0.80 | 0.85 | not reached |", lines)


class Steadiness(Scratch):
    """A still rig of 30 pictures, of which the composite of each is the truth times a factor."""

    def rig(self, factors: list[float]) -> Path:
        def save(name: str, picture: np.ndarray) -> None:
            file = self.folder / name
            file.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(picture).save(file)
        noise = np.random.default_rng(7)
        grey = np.full((40, 40, 3), 180, np.uint8)
        with_object = grey.copy()
        with_object[:, 20:] = 120
        object_mask = np.zeros((40, 40), np.uint8)
        object_mask[:, 36:] = 255
        save("truth/with_00000.png", with_object)
        save("truth/without_00000.png", grey)
        save("masks/object_00000.png", object_mask)
        save("masks/labels_without_00000.png", np.ones((40, 40), np.uint8))
        for k, factor in enumerate(factors):
            grain = noise.normal(0, 2, grey.shape)
            save(f"scene/{k:05d}.png", (grey + grain).round().clip(0, 255).astype(np.uint8))
            linear = colour.linear_from_srgb((with_object + grain * 2 / 3).clip(0, 255) / 255) * factor
            save(f"frames/{k:05d}.png", (255 * colour.srgb_from_linear(linear)).round().astype(np.uint8))
        return self.folder

    def test_a_flickering_picture_is_told_from_a_steady_one(self) -> None:
        rig = self.rig([1.0] * 30)
        self.assertTrue(steadiness.is_still(rig))
        steady = steadiness.steadiness(rig, rig / "frames")
        self.assertLess(steady["pump shadow %"], 0.2)
        self.assertLess(abs(steady["shimmer shadow"] - 1), 0.3)
        rig = self.rig([1.0, 1.05] * 15)
        flickering = steadiness.steadiness(rig, rig / "frames")
        self.assertAlmostEqual(flickering["pump shadow %"], 2.5, delta=0.3)
        self.assertAlmostEqual(flickering["step object %"], 5.0, delta=0.5)

    def test_bars_over_time_can_be_missed(self) -> None:
        rows = {"image-based-shadowing, best": Bars.GOOD, "without": Bars.WITHOUT}
        for pump, good in ((0.04, True), (0.06, False)):
            result = fidelity.Result("desk-still", rows, None, [("pump shadow %", pump, fidelity.STEADY["pump"])])
            self.assertEqual(fidelity.bars_table([result])[1], good)


class NearLamps(Scratch):
    """Variants of rigs with a wrong description, and the verdict on them."""

    def test_a_worse_figure_is_named(self) -> None:
        far = {"s_err": 0.02, "dE": 1.0, "dE_object": 2.0, "bad": 1.0}
        self.assertEqual(near_lamps.row("desk", "as it is", [far, far])[1], [])
        line, worse = near_lamps.row("desk", "as it is", [far | {"s_err": 0.01, "bad": 1.1}, far])
        self.assertEqual(worse, ["bad %"])
        self.assertIn("0.0200 → 0.0100", line)

    def test_phantoms_are_displaced_with_their_poses(self) -> None:
        folder = self.folder
        header = "format binary_little_endian 1.0\nelement vertex 2\n" + "".join(f"property float {c}\n" for c in "xyz")
        points = np.array([[0, 0, 0], [1, 2, 3]], "<f4")
        (folder / "box.ply").write_bytes(f"ply\n{header}element face 0\nend_header\n".encode() + points.tobytes() + b"faces")
        pose = {"matrix_row_major": [[1, 0, 0, 1.0], [0, 1, 0, 2.0], [0, 0, 1, 3.0], [0, 0, 0, 1]], "position": [1.0, 2.0, 3.0]}
        rig = {"phantoms": [{"ply": "box.ply", "pose": pose}]}
        near_lamps.displace_all(folder, rig)
        data = (folder / "box.ply").read_bytes()
        moved = np.frombuffer(data[data.index(b"end_header\n") + 11:][:24], "<f4").reshape(2, 3)
        self.assertTrue(np.allclose(moved - points, near_lamps.DISPLACED, atol=1e-6))
        self.assertTrue(data.endswith(b"faces"))
        self.assertEqual(pose["position"], [row[3] for row in pose["matrix_row_major"][:3]])

    def test_the_darkest_exposure_is_removed(self) -> None:
        folder = self.folder
        (folder / "env").mkdir()
        for picture in ("00000.jpg", "00000_ev-4.jpg", "00000_ev-8.jpg"):
            (folder / "env" / picture).touch()
        rig = {"environment_camera": {"brackets_ev": [-4, -8]}}
        near_lamps.drop_exposure(folder, rig)
        self.assertEqual(rig["environment_camera"]["brackets_ev"], [-4])
        self.assertEqual(sorted(p.name for p in (folder / "env").iterdir()), ["00000.jpg", "00000_ev-4.jpg"])


class Tables(Scratch):
    def test_only_text_between_the_marks_changes(self) -> None:
        page = self.folder / "page.md"
        page.write_text("a\n<!-- t:begin -->\nold\n<!-- t:end -->\nb\n")
        tables.write_between(page, "t", "new")
        self.assertEqual(page.read_text(), "a\n<!-- t:begin -->\nnew\n<!-- t:end -->\nb\n")
        with self.assertRaisesRegex(ValueError, "u:begin"):
            tables.write_between(page, "u", "new")

    def test_result_pages_have_their_marks(self) -> None:
        for mark in ("fidelity", "bench", "calibration", "near-lamps"):
            page = (tables.RESULTS / f"{mark}.md").read_text()
            self.assertLess(page.index(f"<!-- {mark}:begin -->"), page.index(f"<!-- {mark}:end -->"))


class Comparison(Scratch):
    """Programs that print fixed times instead of measuring them."""

    def program(self, name: str, cases: dict[str, list[float]]) -> bench_compare.Side:
        """A program whose n-th run of a case takes the n-th of its times."""
        script = self.folder / name
        script.write_text(f"""#!{sys.executable}
import json, pathlib, sys
case, report = sys.argv[sys.argv.index("--case") + 1], sys.argv[sys.argv.index("--json") + 1]
cases = {cases!r}
if case not in cases:
    sys.exit("error: invalid value '" + case + "' for '--case <NAME>'")
runs = pathlib.Path({str(self.folder / name)!r} + "-" + case)
run = int(runs.read_text()) if runs.exists() else 0
runs.write_text(str(run + 1))
with open({str(self.folder / "order")!r}, "a") as order:
    order.write({name[0]!r})
ms = cases[case][run]
row = dict(case=case, width=8, height=6, lights=4, refreshed_per_frame=1, planes=0, light_changes=False, triangles=5, lamps=0,
           environment=None, wall_ms=dict(p50=ms, p99=ms), passes=[dict(name="composite", ms=ms / 2), dict(name="tiles", ms=1.0)])
json.dump(dict(rows=[row], live=[]), open(report, "w"))
""")
        script.chmod(0o755)
        return bench_compare.Side(name, script)

    def test_ratio_is_taken_pair_by_pair_in_alternating_order(self) -> None:
        # The machine becomes four times slower, and the new program is always 10 % slower.
        machine = [10.0, 20.0, 40.0, 40.0, 40.0, 40.0]
        new = self.program("new", {"supan": [1.1 * ms for ms in machine]})
        old = self.program("old", {"supan": machine})
        text = bench_compare.compare(new, old, ["supan"], 6, [])
        self.assertIn("| supan 8×6, 4 lights, 1 redrawn, 5 triangles | 40.00 | 44.00 | 1.100 | 1.100 to 1.100 (97 %) | slower | composite 20.00 → 22.00", text)
        self.assertEqual((self.folder / "order").read_text(), "onno" * 3)

    def test_missing_case_and_missing_row_are_named(self) -> None:
        new, old = self.program("new", {"supan": [1.0, 1.0], "live": [1.0]}), self.program("old", {"supan": [2.0, 0.5]})
        text = bench_compare.compare(new, old, ["supan", "live"], 2, [])
        self.assertIn("| live | | | | | old: has no such case | |", text)
        self.assertIn("no difference seen", text)
        self.assertEqual(text.count("| live"), 1)
        del old.runs[next(iter(old.runs))]
        self.assertIn("old has no such row", bench_compare.table(new, old))

    def test_interval_of_the_median(self) -> None:
        low, high, confidence = bench_compare.interval([float(i) for i in range(1, 11)])
        # Published: the 2nd and 9th of 10 enclose the median with 97.9 %.
        self.assertEqual((low, high), (2.0, 9.0))
        self.assertAlmostEqual(confidence, 0.979, places=3)
        self.assertEqual(bench_compare.interval([2.0, 1.0]), (1.0, 2.0, 0.5))
        self.assertEqual(bench_compare.interval([2.0]), (2.0, 2.0, 0.0))

    def test_faulty_input_is_refused(self) -> None:
        with self.assertRaisesRegex(bench_compare.Failed, "REV"):
            bench_compare.build("", self.folder)
        with self.assertRaisesRegex(bench_compare.Failed, "git rev-parse"):
            bench_compare.build("no-such-revision", self.folder)
        broken = self.folder / "broken"
        broken.write_text("#!/bin/sh\necho 'error: no graphics adapter' >&2; exit 1\n")
        broken.chmod(0o755)
        side = bench_compare.Side("broken", broken)
        text = bench_compare.compare(side, self.program("old", {"supan": [1.0]}), ["supan"], 3, [])
        self.assertIn("broken: no graphics adapter", text)


class GraphicsCheck(Scratch):
    """A program that prints fixed times."""

    def report(self, software: bool, gpu_ms: float, fails: str = "none") -> tuple[str, bool]:
        program = self.folder / "penumbra"
        program.write_text(f"""#!{sys.executable}
import json, sys
if "{fails}" in sys.argv:
    sys.exit("error: the device burns")
if sys.argv[1] == "doctor":
    print("all is well")
    sys.exit()
ms = dict(p50={gpu_ms}, p99=9.0)
row = dict(case="supan", width=8, height=6, lights=64, refreshed_per_frame=64, planes=0, light_changes=False, triangles=5, lamps=0,
           environment=None, processor_ms=None, fps=1.0, wall_ms=dict(p50=3.0, p99=9.0), gpu_ms=ms, stages=[],
           passes=[dict(name="composite", ms={gpu_ms})])
live = dict(width=8, height=6, lights=64, samples=4, max_wait_ms=20.0, frames_per_second=30.0, arrival_to_picture_ms=dict(p50=20.5, p99=33.0), total_ms=ms)
report = dict(adapter="Test Adapter", software={software}, rows=[row], live=[live], recovery_seconds=0.4)
json.dump(report, open(sys.argv[sys.argv.index("--json") + 1], "w"))
""")
        program.chmod(0o755)
        a = argparse.Namespace(penumbra=program, adapter=None, short=True, out=self.folder / "out", truth=[self.folder])
        good = gpu_check.check(a, gpu_check.steps(a))
        self.assertEqual(gpu_check.adapter_name(a), "llvmpipe" if fails == "supan" else "Test Adapter")
        return (a.out / "report.md").read_text(), good

    def test_report_has_all_sections(self) -> None:
        text, good = self.report(software=False, gpu_ms=0.7)
        self.assertTrue(good, text)
        for part in ("all is well", "| Test Adapter | 8×6 | 64 | 64 |", "median 0.70 ms on the device; allowed 1.0 ms, aim 0.5 ms.", "| 30.0 | 20.50 | 33.00 |", "the next picture came in 0.40 s; allowed 2 s."):
            self.assertIn(part, text)

    def test_missed_bar_fails_on_a_gpu_only(self) -> None:
        text, good = self.report(software=False, gpu_ms=1.1)
        self.assertFalse(good)
        self.assertIn("median 1.10 ms on the device; allowed 1.0 ms.", text)
        text, good = self.report(software=True, gpu_ms=200.0)
        self.assertTrue(good, text)

    def test_wall_time_counts_without_time_stamps(self) -> None:
        text, good = self.report(software=False, gpu_ms=0.0)
        self.assertFalse(good)
        self.assertIn("median 3.00 ms of wall time, because the adapter has no time stamps", text)

    def test_failed_step_is_reported_and_others_run(self) -> None:
        text, good = self.report(software=True, gpu_ms=5.0, fails="live")
        self.assertFalse(good)
        self.assertIn("**Not passed** (exit status 1): `error: the device burns`", text)
        self.assertIn("## Benchmark supan", text)
        text, good = self.report(software=True, gpu_ms=5.0, fails="supan")
        self.assertFalse(good)
        self.assertIn("## Latency of a live rig, 640x480\n\n| size", text)

    def test_tests_are_summed(self) -> None:
        text = gpu_check.tests_section("test a::b ... ok\ntest a::c ... FAILED\ntest result: FAILED. 1 passed; 1 failed\n")
        self.assertEqual(text, "- test result: FAILED. 1 passed; 1 failed\n- failed: `a::c`")


class Agreement(Scratch):
    """Both implementations give the same figures, to the digits of the table."""

    def setUp(self) -> None:
        super().setUp()
        self.compare = SHARED / "truth/compare.py"
        if not self.compare.exists():
            self.skipTest(f"{self.compare} is missing")
        try:
            self.python = python_with(COMPARE_PACKAGES, COMPARE_REQUIREMENTS)
        except Unavailable as error:
            self.skipTest(str(error))

    def test_with_the_independent_implementation(self) -> None:
        names = ("truth/*/truth", "rigs/desk-depth/truth")
        for rig in sorted(found.parent for name in names for found in SHARED.glob(name)):
            with self.subTest(rig=rig.name):
                every = -(-len(judge.frame_numbers(rig)) // 2)
                pictures = self.imperfect(rig, every)
                ours = {"composite": judge.judge_pictures(rig, pictures, every), **judge.judge_baselines(rig, every)}
                theirs = self.theirs(rig, pictures, every)
                for row in ours:
                    for column, _, digits in fidelity.COLUMNS:
                        if column in theirs[row] or column in ours[row]:
                            self.assertAlmostEqual(ours[row][column], theirs[row][column], delta=0.5 * 0.1**digits, msg=f"{row} {column}")

    def imperfect(self, rig: Path, every: int) -> Path:
        """Writes pictures with errors in every region: the ground truth with a weaker shadow, another tint and noise."""
        folder, random = self.folder / rig.name, np.random.default_rng(1)
        folder.mkdir()
        for frame in judge.frame_numbers(rig, every):
            truth = judge.load_truth(rig, frame)
            picture = 0.7 * truth.with_object + 0.3 * truth.without * (1.0, 0.95, 0.9) + random.normal(0, 0.01, truth.without.shape)
            Image.fromarray(np.clip(255 * picture, 0, 255).round().astype(np.uint8)).save(folder / f"{frame:05d}.png")
        return folder

    def theirs(self, rig: Path, pictures: Path, every: int) -> dict[str, dict[str, float]]:
        """Returns the figures of the other implementation, by row and column."""
        table = self.folder / "theirs.csv"
        subprocess.run([self.python, str(self.compare), str(rig), "--composites", str(pictures), "--every", str(every),
                        "--baseline-every", "1", "--no-flip", "--csv", str(table)], check=True, stdout=subprocess.DEVNULL)
        rows: dict[str, list[dict[str, float]]] = {}
        with table.open(newline="") as source:
            for line in csv.DictReader(source):
                rows.setdefault(line["image"], []).append({c: float(line[c]) for c in judge.FIGURES if line[c]})
        return {name: judge.overall(each) for name, each in rows.items()}


class Result(unittest.TextTestResult):
    def addSkip(self, test: unittest.TestCase, reason: str) -> None:
        super().addSkip(test, reason)
        print(f"SKIPPED {test.id().removeprefix('__main__.')}: {reason}")


if __name__ == "__main__":
    unittest.main(testRunner=unittest.TextTestRunner(resultclass=Result))

#!/usr/bin/env python3
"""Make a path-traced rig to calibrate: a camera with lens distortion is moved in front of tags.

Uses rigsim (Mitsuba 3). Every rig has its own lens, mounting, transmitter, latencies and noise,
sampled from --seed; the tracker's field can be distorted as near metal (--metal). rig.json holds
what the rig's owner would know (markers, a rough lens, no mounting, no latency), truth_rig.json
the rest. `tests/judge/calibration.py --simulated DIR` compares calibrations with it.

    tests/judge/rigsim_calibration.py --rigsim ../shared/rigsim -o DIR/waved-1 --seed 1
    tests/judge/rigsim_calibration.py --rigsim ../shared/rigsim -o DIR/board-1 --seed 4 --board chess
    tests/judge/rigsim_calibration.py --rigsim ../shared/rigsim -o DIR/fisheye-1 --seed 6 --frames 8 --fisheye
"""
from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

import numpy as np


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigsim", type=Path, required=True, help="folder of rigsim")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--frames", type=int, default=180)
    parser.add_argument("--rate", type=float, default=15.0, help="pictures per second")
    parser.add_argument("--spp", type=int, default=16, help="samples per pixel")
    parser.add_argument("--board", choices=("chess", "charuco"), help="a board, rendered by OpenCV, in place of the tags")
    parser.add_argument("--fisheye", action="store_true", help="an environment camera that sees the tags; its pose in rig.json has an error of 5 degrees")
    parser.add_argument("--metal", type=float, default=0.0, help="largest error of the tracker's field, metres")
    return parser.parse_args()


class Waved:
    """Camera path around the desk: a wide arc with pitch, roll and sway at incommensurate rates."""

    def __init__(self, rng: np.random.Generator, look_at, rotvec, aside: float) -> None:
        self.look_at, self.rotvec, self.aside = look_at, rotvec, aside
        self.rates, self.phases = rng.uniform(0.25, 1.1, 9), rng.uniform(0, 2 * math.pi, 9)

    def T_world_cam(self, t: float) -> np.ndarray:
        w = np.sin(2 * math.pi * self.rates * t + self.phases)
        bearing = -math.pi / 2 + 0.75 * w[0] + 0.1 * w[6]
        distance, height = 0.5 + 0.1 * w[1], 0.42 + 0.13 * w[2]
        eye = np.array([0.03 + distance * math.cos(bearing), 0.05 + distance * math.sin(bearing), height])
        T = self.look_at(eye, np.array([0.03 + self.aside * w[3], 0.05 + self.aside * w[4], 0.0]))
        T[:3, :3] = T[:3, :3] @ self.rotvec(np.array([0.06 * w[7], 0.06 * w[8], 0.45 * w[5]]))
        return T


def bent(camera_class, k: np.ndarray):
    """rigsim's pinhole with k1, k2, p1, p2, k3 (Brown 1966, OpenCV's order): rays by fixed-point iteration."""
    k1, k2, p1, p2, k3 = (float(x) for x in k)

    class Bent(camera_class):
        def directions(self, u, v, lib):
            p = self.params
            xd, yd = (u - p["cx"]) / p["fx"], (v - p["cy"]) / p["fy"]
            x, y = xd, yd
            for _ in range(12):
                r2 = x * x + y * y
                radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
                x, y = ((xd - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
                        (yd - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial)
            s = 1 / lib.sqrt(x * x + y * y + 1)
            return x * s, y * s, s, s > 0

    return Bent


def fisheye(rng: np.random.Generator, geometry) -> dict:
    """An environment camera on a stand beside the table, tilted so that it sees the room and the tags."""
    bearing = float(rng.uniform(-math.pi, math.pi))
    eye = np.array([0.4 * math.cos(bearing), 0.05 + 0.4 * math.sin(bearing), float(rng.uniform(0.25, 0.4))])
    pose = geometry.look_at(eye, np.array([0.0, 0.05, eye[2] - float(rng.uniform(0.1, 0.4))]))
    return {"kind": "fisheye", "width": 960, "height": 960, "f": 300.0, "cx": 479.5 + float(rng.normal(0, 4)), "cy": 479.5 + float(rng.normal(0, 4)),
            "pose": {"position": pose[:3, 3].tolist(), "quaternion_wxyz": [float(x) for x in geometry.quat(pose[:3, :3])]},
            "rate_hz": 15, "phase_s": 0.01, "frames": 4, "ev": -0.5, "wb": [0.93, 1.0, 1.12], "read_noise": 0.003, "format": "jpg", "quality": 93}


def description(base: dict, a: argparse.Namespace, rng: np.random.Generator, geometry) -> dict:
    """The desk of desk-marker with six tags and another rig."""
    cfg = json.loads(json.dumps(base))
    cfg.update(name=a.out.name, comment="a camera is moved in front of tags, for calibration", seed=a.seed)
    places = [(-0.12, -0.06), (0.19, -0.05), (0.02, 0.22), (-0.2, 0.2), (0.22, 0.2), (0.04, -0.14)]
    tag = cfg["world"]["decals"][0]
    cfg["world"]["decals"] = [
        {**tag, "id": i, "size_m": 0.1 if a.fisheye else 0.07, "position": list(place), "yaw_deg": float(rng.uniform(-180, 180)),
         "image": f"../../data/calibration/apriltag_imgs/tag36_11_0000{i}.png"} for i, place in enumerate(places)]
    if a.board:
        cfg["world"]["decals"] = [{**tag, **board(a)}]
        cfg["world"]["objects"] = []
    f = float(rng.uniform(520, 720))
    cfg["scene_camera"].update(
        frames=a.frames, rate_hz=a.rate, jitter_s=0.004, stamp_latency_s=0.0, fx=f, fy=f,
        cx=319.5 + float(rng.normal(0, 5)), cy=239.5 + float(rng.normal(0, 5)), read_noise=0.004, quality=90)
    angles = rng.uniform(-180, 180, 6).tolist()
    cfg["tracker"].update(
        rate_hz=120, latency_s=float(rng.uniform(0.005, 0.045)), noise_pos_m=0.0003, noise_rot_deg=0.03, units="cm",
        T_world_source={"position": rng.uniform(-0.6, 0.6, 3).tolist(), "yaw_deg": angles[0], "pitch_deg": angles[1] / 3, "roll_deg": angles[2]},
        T_sensor_cam={"position": rng.uniform(-0.06, 0.06, 3).tolist(), "yaw_deg": angles[3], "pitch_deg": angles[4] / 3, "roll_deg": angles[5]})
    if a.fisheye:
        cfg["env_camera"] = fisheye(rng, geometry)
    else:
        cfg["env_camera"]["sphere"]["in_scene"] = False
        cfg["env_camera"].update(frames=1)
    cfg["render"].update(spp=a.spp, denoise=False)
    return cfg


SQUARE, PIXELS = 0.03, 40


def board(a: argparse.Namespace) -> dict:
    """Writes OpenCV's picture of a board of 10 by 7 squares on a white sheet, and the board's description."""
    import cv2
    sheet = np.full((12 * PIXELS, 12 * PIXELS), 255, np.uint8)
    size = (10 * PIXELS, 7 * PIXELS)
    if a.board == "chess":
        drawn = np.kron(np.indices((7, 10)).sum(0) % 2, np.ones((PIXELS, PIXELS))).astype(np.uint8) * 255
        text = f"chess:9x6:{SQUARE}"
    else:
        marker = 0.75 * SQUARE
        words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        drawn = cv2.aruco.CharucoBoard((10, 7), SQUARE, marker, words).generateImage(size)
        text = f"charuco:10x7:{SQUARE}:{marker}:4x4_50"
    sheet[PIXELS:PIXELS + size[1], PIXELS:PIXELS + size[0]] = drawn
    picture = (a.out / "board.png").resolve()
    picture.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(picture), sheet)
    (a.out / "board.json").write_text(json.dumps({"board": text}))
    # One pixel is one cell; the tag is the complete sheet.
    return {"image": str(picture), "margin": 0, "black_cells": 12 * PIXELS, "size_m": 12 * SQUARE, "position": [0.05, 0.1], "yaw_deg": 8.0}


def metal_field(rng: np.random.Generator, largest: float):
    """Returns a smooth error of position (m) and rotation (rad) by position, as caused by conductors near the sensor."""
    shape = rng.normal(0, 1, (3, 10)) * largest
    def field(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u = 2.0 * x
        basis = np.array([u[0], u[1], u[2], u[0] * u[1], u[1] * u[2], u[2] * u[0], u[0] ** 2, u[1] ** 2, u[2] ** 2, 1.0])
        error = np.tanh(0.5 * (shape @ basis) / max(largest, 1e-9)) * largest
        return error, 1.5 * error[[1, 2, 0]]
    return field


def main() -> int:
    a = options()
    sys.path.insert(0, str(a.rigsim.resolve().parent))
    from rigsim import geometry, render, sensor, session
    from rigsim.geometry import inv_rigid, look_at, rotvec
    rng = np.random.default_rng([a.seed, 77])
    render.init()
    lens = np.array([rng.uniform(-0.3, 0.05), rng.uniform(-0.02, 0.12), *rng.normal(0, 0.0008, 2), 0.0])
    base = session.load_session(str(a.rigsim / "scenes/desk-marker.json"))
    made = session.Session(description(base.cfg, a, rng, geometry), base.base_dir)
    made.trajectory = Waved(rng, look_at, rotvec, 0.14 if a.board else 0.05)
    camera = made.scene_cam
    made.scene_cam = bent(render.Camera, lens)(camera.kind, camera.width, camera.height, camera.params)
    if a.metal > 0:
        field, straight = metal_field(rng, a.metal), made.T_world_sensor
        def bent_pose(t: float) -> np.ndarray:
            T = inv_rigid(made.T_world_source) @ straight(t)
            error, turn = field(T[:3, 3])
            T[:3, 3] += error
            T[:3, :3] = rotvec(turn) @ T[:3, :3]
            return made.T_world_source @ T
        made.T_world_sensor = bent_pose
    out = a.out
    (out / "scene").mkdir(parents=True, exist_ok=True)
    (out / "made.json").write_text(json.dumps({"seed": a.seed, "metal": a.metal}))
    made.write_rig(out)
    made.write_timestamps(out)
    made.write_tracker(out)
    hide(out, lens, rng, geometry if a.fisheye else None)
    world, config = made.world(), made.cfg["scene_camera"]
    if a.fisheye:
        (out / "env").mkdir(exist_ok=True)
        scene, _ = world.scene(0.0, False, False)
        for i in range(len(made.env_t)):
            radiance = render.trace(scene, made.env_cam, made.T_world_env, a.spp, 5000 + i, 4)
            look = made.cfg["env_camera"]
            sensor.write_image(out / f"env/{i:05d}.jpg", sensor.develop(np.maximum(radiance, 0), look, np.random.default_rng([a.seed, 9, i])), look)
    for i, t in enumerate(made.scene_t):
        path = out / f"scene/{i:05d}.jpg"
        if path.exists():
            continue
        scene, _ = world.scene(t, False, False)
        radiance = render.trace(scene, made.scene_cam, made.trajectory.T_world_cam(t), a.spp, 1000 + i, 4)
        sensor.write_image(path, sensor.develop(np.maximum(radiance, 0), config, np.random.default_rng([a.seed, i])), config)
        print(f"{i + 1}/{len(made.scene_t)}", file=sys.stderr, flush=True)
    return 0


def hide(out: Path, lens: np.ndarray, rng: np.random.Generator, geometry) -> None:
    """Moves the ground truth to truth_rig.json; rig.json keeps what an owner knows before calibrating."""
    rig = json.loads((out / "rig.json").read_text())
    coefficients = dict(zip(("k1", "k2", "p1", "p2", "k3"), (float(x) for x in lens)))
    truth = json.loads(json.dumps(rig))
    truth["scene_camera"]["lens_distortion"] = coefficients
    (out / "truth_rig.json").write_text(json.dumps(truth, indent=1))
    if geometry:
        camera = rig["environment_camera"]
        pose = geometry.pose_from_json({k: camera["T_world_cam"][k] for k in ("position", "quaternion_wxyz")})
        axis = rng.normal(0, 1, 3)
        pose[:3, :3] = geometry.rotvec(math.radians(5.0) * axis / np.linalg.norm(axis)) @ pose[:3, :3]
        pose[:3, 3] += rng.normal(0, 0.02, 3)
        camera["T_world_cam"] = geometry.pose_to_json(pose)
    else:
        (out / "env_timestamps.csv").unlink()
    bare = (*([] if geometry else ["environment_camera"]), "photometric_chart", *(["markers"] if (out / "board.json").exists() else []))
    for key in bare:
        rig.pop(key, None)
    # The lens has the remaining error of a good calibration.
    K = rig["scene_camera"]["K"]
    K[0][0], K[1][1] = K[0][0] * (1 + rng.normal(0, 2e-4)), K[1][1] * (1 + rng.normal(0, 2e-4))
    rig["scene_camera"]["lens_distortion"] = coefficients if "markers" in rig else "none"
    nothing = {"position": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}
    tracker = rig["tracker"]
    tracker["latency_s"] = 0.0
    for key in ("T_world_source", "T_sensor_cam"):
        tracker[key] = same_form(tracker[key], nothing)
    rig["tracker"] = tracker
    (out / "rig.json").write_text(json.dumps(rig, indent=1))


def same_form(pose: object, nothing: dict) -> object:
    """Returns the identity pose `nothing` in the form of `pose`."""
    if isinstance(pose, dict):
        blank = {}
        for key, value in pose.items():
            if "quat" in key:
                blank[key] = [1, 0, 0, 0]
            elif isinstance(value, list) and len(value) == 3:
                blank[key] = [0, 0, 0]
            elif isinstance(value, list) and len(value) == 4:
                blank[key] = np.eye(4).tolist()
            else:
                blank[key] = value
        return blank
    return nothing


if __name__ == "__main__":
    sys.exit(main())

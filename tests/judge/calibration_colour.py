"""White balance between two cameras, compared with known gains."""
from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from calibration_judge import Judge, Row, pictures_in, present, truth_of

#: Linear gains by which a second camera is simulated from a photograph.
OTHER_CAMERA = (0.62, 0.8, 0.95)


def as_other_camera(picture: np.ndarray) -> np.ndarray:
    """Returns the picture (B, G, R codes) with OTHER_CAMERA's gains applied in linear light."""
    code = picture[:, :, ::-1] / 255.0
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4) * OTHER_CAMERA
    code = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (255 * code[:, :, ::-1]).round().astype(np.uint8)


def charts(j: Judge) -> Iterator[Row]:
    """Photographs of ColorCheckers, each paired with a copy with other gains: the program must recover the gains."""
    folder = j.data("colorchecker")
    photographs = [*pictures_in(folder, "arcu/*.jpg"), *pictures_in(folder, "macduff/*.jpg")]
    worst = 0.0
    for file in photographs:
        work = j.folder(f"chart-{file.stem}")
        other = work / "other.png"
        cv2.imwrite(str(other), as_other_camera(cv2.imread(str(file), cv2.IMREAD_COLOR)))
        found = j.calibrate(work, "radiometric", "radiometric.json", "--scene-picture", file, "--environment-picture", other)
        worst = max(worst, *(100 * abs(gain * other - 1) for gain, other in zip(found["gains"]["rgb"], OTHER_CAMERA)))
    yield Row(f"{len(photographs)} photographs of ColorCheckers", "white balance, worst of all", worst, 2.0, "%, worst channel", "known gains")


def white_balance(j: Judge) -> Iterator[Row]:
    """Path-traced rigs with two cameras."""
    for session in sorted(path.parent for path in present(j.a.truth).glob("*/truth_rig.json")):
        truth = truth_of(session)
        if "environment_camera" not in truth:
            j.skip(f"white balance of {session.name}", "it has no environment camera")
            continue
        work = j.folder(f"{session.name}-radiometric")
        found = j.calibrate(work, "radiometric", "radiometric.json", "--session", j.imported(work, session))
        total = [truth[c]["response_truth"]["total_gain_rgb"] for c in ("scene_camera", "environment_camera")]
        off = [100 * abs(g / (s / e) - 1) for g, s, e in zip(found["gains"]["rgb"], *total)]
        yield Row(session.name, f"white balance by {found['gains']['method']}", max(off), 2.0, "%, worst channel", "ground truth")

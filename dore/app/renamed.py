"""Config keys and options of version 0.1 that have been renamed."""

from __future__ import annotations

import re

KEYS = {
    "eye.eye_m": "camera.position_m",
    "eye": "camera",
    "camera.eye_m": "camera.position_m, or view.position_m for the film",
    "camera.frames_per_s": "view.frames_per_s",
    "camera.playback_speed": "view.playback_speed",
    "camera.shadows": "view.shadows",
    "view.eye_m": "view.position_m",
    "arm.lane_margin_m": "arm.corridor_margin_m",
    "arm.heading_limit_deg": "arm.max_yaw_deg",
    "paper": "experiment=paper/single, experiment=paper/sequential or experiment=paper/single_3x6",
}
OPTIONS = {
    **{f"camera/{name}": f"view={name}" for name in ("corner", "corner_large", "corner_page")},
    "disturbance/stranger": "disturbance=intruder",
    "experiment/paper/table4": "experiment=paper/single or experiment=paper/sequential",
    "experiment/paper/single_6x6": "experiment=paper/single",
    "experiment/ablation/literal": "experiment=ablation/literal_single or experiment=ablation/literal_sequential",
}


def hint(text: str) -> str | None:
    """One line that names the new key or option, where Hydra's error is about an old one."""
    unknown = re.search(r"Could not override '([^'@]+)", text)
    if unknown:
        key = unknown[1].replace("/", ".")
        old = next((old for old in KEYS if key == old or key.startswith(f"{old}.")), None)
        return old and f"{key}: renamed, want {KEYS[old]}{key.removeprefix(old)}"
    missing = re.search(r"Could not find '([^']+)'", text)
    if missing and missing[1] in OPTIONS:
        return f"{missing[1].replace('/', '=', 1)}: renamed, want {OPTIONS[missing[1]]}"
    return None

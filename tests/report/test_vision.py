"""What the camera sees: rows of the measuring program, and the page made of them."""

from __future__ import annotations

import pytest

from dore.report import results
from dore.report.measurements import write_measurements
from scripts import measure_vision
from scripts.program import run
from tests.rendering import needs_vulkan
from tests.report import fakes

ABOUT = {"seed": 1, "camera": "kinect", "rendering": "cpu", "seconds": "9", "wrong": "with noise=kinect: two targets"}


def page_of(root) -> str:
    return results.write_page(fakes.study("vision"), "vision", root, root / "pages").read_text(encoding="utf-8")


def test_the_page_by_hand(tmp_path):
    """Errors are of what was found, whatever their sign; shares are of all objects."""
    errors = dict.fromkeys(("centre_mm", "height_mm", "width_mm", "yaw_deg"))
    seen = {"cell": True, "upright": True, "shape": True} | errors
    objects = [seen | {"noise": "kinect", "centre_mm": 1.0, "height_mm": one} for one in (-1.0, 2.0, 3.0)]
    objects += [seen | {"noise": "kinect", "cell": False, "upright": False, "shape": False}]
    objects += [seen | {"noise": "none", "centre_mm": 1.0, "height_mm": 0.0, "yaw_deg": -0.5}]
    scenes = [
        {
            "noise": noise,
            "exact": exact,
            "understood": True,
            "target": True,
            "wrong": "",
            "frame_s": 0.1,
            "reading_s": 0.2,
        }
        for noise, exact in (("kinect", True), ("kinect", False), ("none", True))
    ]
    lying = [{"scene": number, "reported": number != 0} for number in range(4)]
    hidden = [{"scene": number // 3, "detected": number < 4, "missed": number == 5} for number in range(6)]
    for name, rows in (("objects", objects), ("lying", lying), ("hidden", hidden), ("scenes", scenes)):
        write_measurements(tmp_path / name, rows, **ABOUT)
    page = page_of(tmp_path)
    assert "| cells right | 3 of 4 [30.1, 95.4] % | 1 of 1 [20.7, 100.0] % |" in page
    assert "| scenes exact | 1 of 2 [9.5, 90.5] % |" in page
    assert "| height, mm | 2.00 / 2.90 | 0.00 / 0.00 |" in page
    assert "| yaw of a cuboid, degrees | - | 0.50 / 0.50 |" in page
    assert "which are 3 and 1." in page
    assert "| understood within three looks | 2 of 2 [34.2, 100.0] % |" in page
    assert "of 6 looks, three a scene, 4 detected it and 1 missed it" in page
    assert "reported in 3 of 4 [30.1, 95.4] % scenes" in page
    assert "Not understood: with noise=kinect: two targets." in page
    assert "nan" not in page


@pytest.mark.slow
@needs_vulkan
def test_two_scenes(tmp_path):
    picture = tmp_path / "new" / "vision.png"
    words = [f"out={tmp_path}", "scenes=2", "lying=1", "hidden=1", f"picture={picture}"]
    assert run(measure_vision.main, measure_vision.Options, words) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "| scenes exact | 2 of 2 [34.2, 100.0] % | 2 of 2 [34.2, 100.0] % |" in page_of(tmp_path)


def test_what_is_asked_for_wrongly(capsys, tmp_path):
    words = [f"out={tmp_path}", "scenes=0"]
    assert run(measure_vision.main, measure_vision.Options, words) == 2
    assert "measure_vision: scenes: got 0" in capsys.readouterr().err

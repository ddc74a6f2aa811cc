"""Where a command may write: checked before any work, and never shared by the jobs of a sweep."""

from __future__ import annotations

import json
import os
import threading
import time
from pathlib import Path

import pytest

from dore.errors import InputError
from dore.files import atomic_write, check_outputs, conf_dir
from tests.commands import run

FIG_7 = f"scene={conf_dir() / 'scenes' / 'fig7.json'}"
EXACT = ("planner=exact", "reach=published", FIG_7)


def test_folders_are_made_and_a_link_is_followed(tmp_path: Path) -> None:
    check_outputs(out=tmp_path / "new" / "folder" / "plan.json")
    assert (tmp_path / "new" / "folder").is_dir()
    (tmp_path / "real.json").write_text("before")
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    with atomic_write(tmp_path / "link.json") as file:
        file.write("after")
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "real.json").read_text() == "after"


def test_what_is_no_file_of_its_own_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link.png").symlink_to(tmp_path / "plan.json")
    for out, says in (
        (tmp_path, "is a folder"),
        (tmp_path / "pipe", "no regular file"),
        (Path("/dev/null"), "no regular"),
    ):
        with pytest.raises(InputError, match=rf"^out: .*{says}"):
            check_outputs(out=out)
    with pytest.raises(InputError, match=r"^picture: .* is the file of out too, want two files$"):
        check_outputs(out=tmp_path / "plan.json", picture=tmp_path / "link.png")


@pytest.mark.parametrize("outputs", [("out=x.png",), ("out=q.json", "picture=q.json"), ("out=.",), ("out=/dev/null",)])
def test_dore_plan_refuses_before_it_plans(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, outputs: tuple[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("plan", [*EXACT, *outputs]) == 2
    assert list(tmp_path.iterdir()) == []


def test_a_plan_goes_into_a_new_folder_and_stays_when_its_picture_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def no_picture(*_: object) -> None:
        raise OSError(28, "No space left on device", "plan.png")

    monkeypatch.setattr("dore.draw.boards.draw_plan", no_picture)
    assert run("plan", [*EXACT, "out=new/plan.json"]) == 2
    assert json.loads((tmp_path / "new" / "plan.json").read_text())["status"] == "solved"


def test_jobs_of_a_sweep_write_to_folders_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("plan", ["-m", "planner=straight_line,exact", "seed=0,1", "layout=3x6"]) in (0, 4)
    plans = sorted(tmp_path.glob("outputs/sweeps/*/*/plan.json"))
    assert len(plans) == 4
    assert {json.loads(path.read_text())["planner"] for path in plans} == {"straight_line", "exact"}
    assert run("plan", ["-m", "seed=0,1", "planner=exact", f"out={tmp_path / 'shared.json'}"]) == 2
    assert not (tmp_path / "shared.json").exists()


def test_an_evaluation_at_work_cannot_be_resumed_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    given = ["planner=straight_line", "layout=3x6", "instances=z3-7", "limit=5"]
    assert run("evaluate", [*given, f"run_dir={folder}"]) == 0
    rows = (folder / "rows.csv").read_bytes()
    held, release = threading.Event(), threading.Event()

    def hold() -> None:
        from dore.files import locked

        with locked(folder, "resume"):
            held.set()
            release.wait(60)

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait(10)
    time.sleep(0.01)
    assert run("evaluate", [f"resume={folder}"]) == 2
    release.set()
    thread.join()
    assert "is in use by another process" in capsys.readouterr().err
    assert (folder / "rows.csv").read_bytes() == rows
    assert run("evaluate", [f"resume={folder}"]) == 0

"""Every run of the ablations learns, and changes what it says and nothing else."""

from __future__ import annotations

from pathlib import Path

import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra

from dore.app.learning_keys import LEARNING, leaves
from dore.app.training import trainer_of
from dore.files import conf_dir
from dore.report.runs import StudyRun, jobs_of
from tests.report.fakes import study

EVERY = [job for jobs in jobs_of(study("ablation"), Path("out")) for job in jobs]
JOBS = [job for job in EVERY if job.kind == "train" and job.folder.name.endswith("seed0")]
COMMON = ("experiment", "agent", "seed", "training.clock", "training.max_updates", "training.max_minutes")
"""The keys that every run is given."""
SMALL = ["instances.train_size=20", "instances.validation_size=20", "ipt.batch_size=20", "env.num_envs=4"]
SMALL += ["training.learning_starts=1", "training.fill=0"]


def key_of(word: str) -> str:
    return word.removeprefix("~").split("=")[0]


def composed(job: StudyRun, own: bool = True):
    GlobalHydra.instance().clear()
    words = [word for word in job.words if own or key_of(word) in COMMON]
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose("train", [*words, *SMALL])


@pytest.mark.parametrize("job", JOBS, ids=lambda job: job.folder.name)
def test_every_change_learns_and_changes_what_it_says(job):
    cfg = composed(job)
    trainer = trainer_of(cfg)
    while not trainer.progress.updates:
        trainer.iterate()
    was, now = dict(leaves(composed(job, own=False))), dict(leaves(cfg))
    changed = [key for key in {*was, *now} if was.get(key) != now.get(key) and key.split(".")[0] in LEARNING]
    keys = {key_of(word) for word in job.words} - {*COMMON}
    assert all(any(one == key or one.startswith(f"{key}.") for key in keys) for one in changed), changed
    assert bool(changed) == ("_none_" not in job.folder.name)


def test_every_key_of_the_issue_is_there():
    wanted = {"none", "mask", "chain", "heads", "target-update", "learning-rate", "symmetry", "step-cost", "double"}
    ours = {"encoding", "network", "averaging", "precision"}
    found = [job.folder.name.split("_") for job in JOBS]
    for base, more in (("improved", ours), ("literal", set())):
        assert {change for one, _, change, _ in found if one == base} == wanted | more

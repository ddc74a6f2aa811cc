"""Small worlds that many tests share."""

from __future__ import annotations

from functools import partial

import torch

from dore.learn.agents.sequential import Sequential
from dore.learn.agents.single import Single
from dore.learn.env import RearrangeEnv, Rewards
from dore.learn.networks import MLP, NetworkFactory
from dore.world.generator import Difficulty, FreshInstances
from dore.world.reach import Reach

REWARDS = Rewards(solved=10.0, unfinished=0.0, failed=-1.0)


def make_env(reach: Reach, num_envs: int, most: int, max_moves: int = 8, seed: int = 0, least: int = 2) -> RearrangeEnv:
    """An environment with fresh training instances of `least` to `most` obstacles."""
    source = FreshInstances(reach, Difficulty(least, most), "train", seed)
    return RearrangeEnv(reach, source, num_envs, max_moves, REWARDS)


def tiny_network() -> NetworkFactory:
    """A small MLP."""
    return partial(MLP, widths=[32])


def make_agent(
    kind: str, literal: bool, reach: Reach, slots: int = 5, network: NetworkFactory | None = None, mirrored: bool = True
) -> Sequential | Single:
    """An agent of either structure, in its improved or its literal form; `mirrored`: the layout is."""
    torch.manual_seed(0)
    common = {
        "reach": reach,
        "network": tiny_network() if network is None else network,
        "encoding": "state" if literal else "planes",
        "mask_mode": "literal" if literal else "legal",
        "gamma": 0.9,
        "double": not literal,
        "loss_function": "l2" if literal else "smooth_l1",
        "symmetry": not literal and mirrored,
    }
    if kind == "sequential":
        return Sequential(chain="literal" if literal else "natural", **common)
    return Single(n_slots=slots, heads="independent", **common)

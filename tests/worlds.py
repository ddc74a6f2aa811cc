"""Small worlds that many tests share."""

from __future__ import annotations

from functools import partial

import torch

from dore.learn import keys
from dore.learn.agents.sequential import Sequential
from dore.learn.agents.single import Single
from dore.learn.env import RearrangeEnv, Rewards
from dore.learn.networks import MLP, NetworkFactory
from dore.world.board import pack
from dore.world.generator import Difficulty, FreshInstances, InstanceSource
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import legal_places

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


def random_legal(env: RearrangeEnv, observation, generator: torch.Generator):
    """The same TensorDict with a random legal move in every row."""
    pick = observation[keys.LEGAL_PICK].float().multinomial(1, generator=generator).squeeze(-1)
    places = legal_places(env.reach, observation[keys.BOARD], observation[keys.TARGET], observation[keys.VISITED], pick)
    place = places.float().multinomial(1, generator=generator).squeeze(-1)
    return observation.set(keys.PICK, pick).set(keys.PLACE, place)


class Given(InstanceSource):
    """A source that always gives the same batch."""

    def __init__(self, reach: Reach, batch: Batch) -> None:
        super().__init__(reach, seed=0)
        self.batch = batch

    def draw(self, n: int) -> Batch:
        return Batch(self.batch.board[:n], self.batch.target[:n])


def board_of(reach, *cells: int):
    occupied = torch.zeros(1, reach.n_cells, dtype=torch.bool)
    occupied[0, list(cells)] = True
    return pack(occupied)

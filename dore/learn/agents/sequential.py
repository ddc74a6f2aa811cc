"""The sequentially separated DQN (paper, section 5.2): one network picks, one places after the lift."""

from __future__ import annotations

import copy
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor

from dore.errors import one_of
from dore.learn import keys
from dore.learn.agents.common import Greedy, check_hyperparameters, mirror_rows, never_empty
from dore.learn.features import Encoding, encode, n_planes
from dore.learn.losses import PICKED, Chain, FailedPick, SequentialLoss
from dore.learn.networks import NetworkFactory
from dore.learn.q_loss import MaskMode, masked
from dore.world.episode import Episodes
from dore.world.reach import Reach
from dore.world.rules import accessibility, going_back, lift

_SEEN_PICK, _SEEN_PLACE = ("pick", keys.OBSERVATION), ("place", keys.OBSERVATION)


class Sequential:
    """Q_p on [s, m_p] chooses the obstacle; it is lifted; Q_l on [s', m_l] chooses its new cell.

    The lift is part of the policy, so that one environment step is one pick-and-place.

    Args:
        reach: the layout's accessibility check; its device is the agent's.
        network: makes the pick and the place network.
        encoding: see `dore.learn.features.Encoding`.
        mask_mode: see `dore.learn.q_loss.masked`. `legal` also rules out going back to a visited board.
        chain, failed_pick: see `dore.learn.losses.SequentialLoss`.
        gamma: discount of a move.
        double: double Q-learning (the paper's DQN is plain).
        loss_function: smooth_l1 or l2 (the paper's, eq. 3).
        symmetry: learn from each stored move or its mirror image, by chance (the paper does not).

    Raises:
        InputError: a hyperparameter outside its domain, or symmetry on a layout without a mirror.
    """

    def __init__(
        self,
        reach: Reach,
        network: NetworkFactory,
        encoding: Encoding,
        mask_mode: MaskMode,
        chain: Chain,
        gamma: float,
        double: bool,
        loss_function: str,
        symmetry: bool,
        failed_pick: FailedPick = "skip",  # Model files of version 0.1 do not name it.
    ) -> None:
        check_hyperparameters(gamma, double, mask_mode, encoding, loss_function, symmetry, reach)
        one_of("agent.chain", chain, Chain)
        one_of("agent.failed_pick", failed_pick, FailedPick)
        self.reach, self.encoding, self.mask_mode = reach, encoding, mask_mode
        self.chain, self.symmetry = chain, symmetry
        planes, cells = n_planes(encoding, with_mask=True), reach.n_cells
        self.networks = torch.nn.ModuleDict(
            {head: network(layout=reach.layout, n_planes=planes, n_outputs=(cells,)) for head in ("pick", "place")}
        ).to(reach.device)
        pick, place = self._q_modules()
        self.loss = SequentialLoss(pick, place, gamma, double, mask_mode, chain, failed_pick, loss_function)
        self._make_policy()
        rewards = (keys.PLACE_REWARD,) if chain == "natural" else (keys.PLACE_REWARD, keys.PICK_REWARD)
        after = (keys.BOARD, keys.TERMINATED, *rewards)
        self.stored: tuple[str | keys.Key, ...] = (
            keys.BOARD,
            keys.TARGET,
            keys.PICK,
            keys.PLACE,
            *(("next", key) if isinstance(key, str) else ("next", *key) for key in after),
        )

    def _q_modules(self) -> tuple[TensorDictModule, TensorDictModule]:
        """Q_p and Q_l over TensorDicts."""
        return (
            TensorDictModule(self.networks["pick"], in_keys=[_SEEN_PICK], out_keys=[keys.PICK_VALUE]),
            TensorDictModule(self.networks["place"], in_keys=[_SEEN_PLACE], out_keys=[keys.PLACE_VALUE]),
        )

    def _make_policy(self) -> None:
        """Pick, lift, place on this reach's cells."""
        cells, mode, device = self.reach.n_cells, self.mask_mode, self.reach.device
        pick, place = self._q_modules()
        self._greedy = [
            Greedy(keys.PICK, keys.PICK_VALUE, keys.PICK_MASK, cells, mode, device),
            Greedy(keys.PLACE, keys.PLACE_VALUE, keys.PLACE_MASK, cells, mode, device),
        ]
        before_pick = TensorDictModule(
            self._see_pick,
            in_keys=[keys.BOARD, keys.TARGET, keys.PICKABLE, keys.PICK_MASK],
            out_keys=[_SEEN_PICK, keys.PICK_MASK],
        )
        before_place = TensorDictModule(
            self._see_place,
            in_keys=[keys.BOARD, keys.TARGET, keys.VISITED, keys.PICK],
            out_keys=[_SEEN_PLACE, keys.PLACE_MASK],
        )
        self.policy = TensorDictSequential(
            before_pick,
            pick,
            *self._greedy[0].modules_in_order(),
            before_place,
            place,
            *self._greedy[1].modules_in_order(),
        )

    def on(self, reach: Reach) -> Sequential:
        """This agent, weights, loss and all, on another layout or reach; its networks must serve every layout."""
        other = copy.copy(self)
        other.reach = reach
        other._make_policy()
        return other

    def greedy(self, episodes: Episodes) -> tuple[Tensor, Tensor]:
        """The (pick, place) cells chosen where the policy does not explore; see `Agent.greedy`."""
        board, target, legal = episodes.board, episodes.target, episodes.legal
        seen, mask = self._see_pick(board, target, legal.pickable, legal.pick)
        pick = masked(self.networks["pick"](seen)[0], mask, self.mask_mode).argmax(-1)
        seen, mask = self._see_place(board, target, episodes.visited, pick)
        return pick, masked(self.networks["place"](seen)[0], mask, self.mask_mode).argmax(-1)

    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]: Q_p of each cell on Int64[N, W] boards; of one that cannot be picked it means nothing."""
        mask = accessibility(self.reach, board, target).pick
        values: Tensor = self.networks["pick"](encode(self.reach, board, target, mask, self.encoding))[0]
        return values

    def move_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]: Q_l of each cell for the obstacle on Int64[N] cells of Int64[N, W] boards, once it is lifted."""
        lifted = lift(board, pick)
        mask = accessibility(self.reach, lifted, target).place
        values: Tensor = self.networks["place"](encode(self.reach, lifted, target, mask, self.encoding))[0]
        return values

    def set_epsilon(self, epsilon: float) -> None:
        """How often a head acts at random."""
        for greedy in self._greedy:
            greedy.set_epsilon(epsilon)

    def decode(self, batch: TensorDictBase) -> TensorDict:
        """Stored transitions, with observations and masks of the pick, the lift, the place and what follows."""
        board, target, following = batch[keys.BOARD], batch[keys.TARGET], batch["next", keys.BOARD]
        pick, place = batch[keys.PICK], batch[keys.PLACE]
        if self.symmetry:
            rows = torch.rand(board.shape[:1], device=board.device) < 0.5
            (board, following), (target, pick, place) = mirror_rows(
                rows, self.reach, [board, following], [target, pick, place]
            )
        lifted = lift(board, pick)
        literal = self.chain == "literal"
        decoded = self._entry(board, target, "pick")
        picked = decoded[keys.PICK_MASK].gather(-1, pick[:, None]).squeeze(-1)
        on_lifted = self._entry(lifted, target, *(("pick", "place") if literal else ("place",)))
        after = self._entry(following, target, "place" if literal else "pick")
        after.update(batch["next"].select(keys.TERMINATED, keys.PLACE_REWARD, keys.PICK_REWARD, strict=False))
        decoded.update({"place": on_lifted["place"], keys.PICK: pick, keys.PLACE: place, PICKED: picked, "next": after})
        if literal:
            ends = on_lifted["opened"] | ~picked
            decoded["lifted"] = on_lifted.select("pick").update({keys.TERMINATED: ends[:, None]})
        return decoded

    def _entry(self, board: Tensor, target: Tensor, *heads: str) -> TensorDict:
        """The observations and masks of these heads on a board, and whether its target is accessible."""
        found = accessibility(self.reach, board, target)
        masks = {"pick": found.pick, "place": found.place}
        entries: dict[str, Any] = {
            head: {
                keys.OBSERVATION: encode(self.reach, board, target, masks[head], self.encoding),
                "mask": masks[head],
            }
            for head in heads
        }
        return TensorDict({**entries, "opened": found.target}, batch_size=board.shape[:1])

    def _see_pick(self, board: Tensor, target: Tensor, in_reach: Tensor, legal: Tensor) -> tuple[Tensor, Tensor]:
        """The pick network's observation [s, m_p], and what it may choose."""
        seen = encode(self.reach, board, target, in_reach, self.encoding)
        return seen, never_empty(legal if self.mask_mode == "legal" else in_reach)

    def _see_place(self, board: Tensor, target: Tensor, visited: Tensor, pick: Tensor) -> tuple[Tensor, Tensor]:
        """The place network's observation [s', m_l] after the lift, and what it may choose."""
        lifted = lift(board, pick)
        mask = accessibility(self.reach, lifted, target).place
        seen = encode(self.reach, lifted, target, mask, self.encoding)
        if self.mask_mode == "legal":
            mask = mask & ~going_back(lifted, visited, self.reach.n_cells)
        return seen, never_empty(mask)

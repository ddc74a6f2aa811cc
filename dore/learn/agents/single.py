"""The single DQN (paper, section 5.1): one network, one head for what to pick, one for where to place."""

from __future__ import annotations

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor

from dore.errors import one_of, whole
from dore.learn import keys
from dore.learn.agents.common import Greedy, check_hyperparameters, mirror_rows, never_empty
from dore.learn.features import Encoding, encode, n_planes, slot_of, slots
from dore.learn.losses import Heads, SingleLoss
from dore.learn.networks import NetworkFactory
from dore.learn.q_loss import MaskMode, masked
from dore.world.episode import Episodes
from dore.world.reach import Reach
from dore.world.rules import accessibility, legal_moves, legal_places

_SEEN = ("pick", keys.OBSERVATION)
_SLOT_CELLS = ("pick", "slot_cells")


class Single:
    """Q1 on the Z slots of obstacles, ascending by cell, and Q2 on the G cells, of one trunk (eqs. 8-9).

    A slot that holds no obstacle is ruled out, or, in the literal form, a pick fail.

    Args:
        reach: the layout's accessibility check; its device is the agent's.
        network: makes the network.
        n_slots: Z, the most obstacles that the pick head can tell apart.
        encoding: see `dore.learn.features.Encoding`; `planes` also shows m_p, which the paper gives only to the
            separated networks.
        mask_mode: `legal`: only legal slots and, given the slot, legal places are chosen. `literal`: the plain
            argmax of eqs. 8-9, failures and all.
        heads: see `dore.learn.losses.SingleLoss`.
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
        n_slots: int,
        encoding: Encoding,
        mask_mode: MaskMode,
        heads: Heads,
        gamma: float,
        double: bool,
        loss_function: str,
        symmetry: bool,
    ) -> None:
        check_hyperparameters(gamma, double, mask_mode, encoding, loss_function, symmetry, reach)
        one_of("agent.heads", heads, Heads)
        self.reach, self.encoding, self.mask_mode, self.symmetry = reach, encoding, mask_mode, symmetry
        self.n_slots = whole("agent.n_slots", n_slots, 1)
        planes, cells = n_planes(encoding, with_mask=encoding != "state"), reach.n_cells
        made = network(layout=reach.layout, n_planes=planes, n_outputs=(n_slots, cells))
        self.networks = torch.nn.ModuleDict({"pick_place": made}).to(reach.device)
        values = TensorDictModule(made, in_keys=[_SEEN], out_keys=[keys.SLOT_VALUE, keys.PLACE_VALUE])
        self._greedy = [
            Greedy(keys.SLOT, keys.SLOT_VALUE, keys.SLOT_MASK, n_slots, mask_mode, reach.device),
            Greedy(keys.PLACE, keys.PLACE_VALUE, keys.PLACE_MASK, cells, mask_mode, reach.device),
        ]
        before_pick = TensorDictModule(
            self._see_slots,
            in_keys=[keys.BOARD, keys.TARGET, keys.PICKABLE, keys.PICK_MASK],
            out_keys=[_SEEN, _SLOT_CELLS, keys.SLOT_MASK],
        )
        before_place = TensorDictModule(
            self._take_slot,
            in_keys=[keys.BOARD, keys.TARGET, keys.VISITED, _SLOT_CELLS, keys.SLOT],
            out_keys=[keys.PICK, keys.PLACE_MASK],
        )
        self.policy = TensorDictSequential(
            before_pick,
            values,
            *self._greedy[0].modules_in_order(),
            before_place,
            *self._greedy[1].modules_in_order(),
        )
        self.loss = SingleLoss(values, gamma, double, mask_mode, heads, loss_function)
        self.stored: tuple[str | keys.Key, ...] = (
            keys.BOARD,
            keys.TARGET,
            keys.SLOT,
            keys.PLACE,
            ("next", keys.BOARD),
            ("next", keys.TERMINATED),
            ("next", *keys.PLACE_REWARD),
        )

    def set_epsilon(self, epsilon: float) -> None:
        """How often a head acts at random."""
        for greedy in self._greedy:
            greedy.set_epsilon(epsilon)

    def greedy(self, episodes: Episodes) -> tuple[Tensor, Tensor]:
        """The (pick, place) cells chosen where the policy does not explore; see `Agent.greedy`."""
        board, target, legal = episodes.board, episodes.target, episodes.legal
        seen, cells, slot_mask = self._see_slots(board, target, legal.pickable, legal.pick)
        of_slot, of_place = self.networks["pick_place"](seen)
        slot = masked(of_slot, slot_mask, self.mask_mode).argmax(-1)
        pick, place_mask = self._take_slot(board, target, episodes.visited, cells, slot)
        return pick, masked(of_place, place_mask, self.mask_mode).argmax(-1)

    def move_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]: the mean of Q1 of an obstacle and Q2 of each cell, for Int64[N] picks on Int64[N, W] boards.

        An obstacle past the last slot is valued as the last one."""
        slot = slot_of(board, pick, self.reach.n_cells).clamp_max(self.n_slots - 1)
        seen = self._observe(board, target, accessibility(self.reach, board, target).pick)
        of_slot, of_place = self.networks["pick_place"](seen)
        values: Tensor = (of_slot.gather(1, slot[:, None]) + of_place) / 2
        return values

    def decode(self, batch: TensorDictBase) -> TensorDict:
        """Stored transitions, with observations and masks of this board and the next."""
        board, target, following = batch[keys.BOARD], batch[keys.TARGET], batch["next", keys.BOARD]
        slot, place = batch[keys.SLOT], batch[keys.PLACE]
        if self.symmetry:
            board, following, target, slot, place = self._mirror(board, following, target, slot, place)
        decoded = self._entry(board, target)
        after = self._entry(following, target)
        after.update(batch["next"].select(keys.TERMINATED, keys.PLACE_REWARD))
        return decoded.update({keys.SLOT: slot, keys.PLACE: place, "next": after})

    def _mirror(
        self, board: Tensor, following: Tensor, target: Tensor, slot: Tensor, place: Tensor
    ) -> tuple[Tensor, ...]:
        """Half of the rows mirrored; a mirrored obstacle has another slot."""
        rows = torch.rand(board.shape[:1], device=board.device) < 0.5
        cells, there = slots(board, self.n_slots, self.reach.n_cells)
        pick = cells.gather(1, slot[:, None]).squeeze(1)
        (board, following), (target, pick, place) = mirror_rows(
            rows, self.reach, [board, following], [target, pick, place]
        )
        held = there.gather(1, slot[:, None]).squeeze(1)
        mirrored_slot = slot_of(board, pick, self.reach.n_cells).clamp_max(self.n_slots - 1)
        return board, following, target, torch.where(held, mirrored_slot, slot), place

    def _entry(self, board: Tensor, target: Tensor) -> TensorDict:
        """What the network sees of a board, and the masks of its two heads."""
        legal = legal_moves(self.reach, board, target, board[:, None])
        seen = self._observe(board, target, legal.pickable)
        _, slot_mask = self._slots(board, target, legal.pick)
        # Which pick a place goes with is not known here: a place counts that is open whatever is lifted.
        place_mask = legal.place if self.mask_mode == "legal" else torch.ones_like(legal.place)
        return TensorDict(
            {"pick": {keys.OBSERVATION: seen, "slot_mask": slot_mask}, "place": {"mask": place_mask}},
            batch_size=board.shape[:1],
        )

    def _see_slots(
        self, board: Tensor, target: Tensor, in_reach: Tensor, legal: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The observation, the cell of each slot, and which slots may be chosen: at least one in every row."""
        cells, slot_mask = self._slots(board, target, legal)
        return self._observe(board, target, in_reach), cells, never_empty(slot_mask)

    def _observe(self, board: Tensor, target: Tensor, in_reach: Tensor) -> Tensor:
        """Float[B, C, G]: the board, and m_p unless the encoding is the paper's."""
        mask = None if self.encoding == "state" else in_reach
        return encode(self.reach, board, target, mask, self.encoding)

    def _slots(self, board: Tensor, target: Tensor, legal: Tensor) -> tuple[Tensor, Tensor]:
        """Int64[B, Z]: the cell of each slot, and Bool[B, Z]: which slots may be chosen."""
        cells, there = slots(board, self.n_slots, self.reach.n_cells)
        # No obstacle ever stands on the target's cell, so an absent slot is a pick that fails.
        cells = torch.where(there, cells, target[:, None])
        return cells, legal.gather(1, cells) if self.mask_mode == "legal" else torch.ones_like(there)

    def _take_slot(
        self, board: Tensor, target: Tensor, visited: Tensor, cells: Tensor, slot: Tensor
    ) -> tuple[Tensor, Tensor]:
        """The cell of the chosen slot, and where its obstacle may go."""
        pick = cells.gather(1, slot[:, None]).squeeze(1)
        if self.mask_mode == "literal":
            return pick, torch.ones(len(pick), self.reach.n_cells, dtype=torch.bool, device=pick.device)
        return pick, never_empty(legal_places(self.reach, board, target, visited, pick))

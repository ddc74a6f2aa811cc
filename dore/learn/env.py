"""The rearrangement problem as a batched TorchRL environment: a thin shell around `dore.world.rules`."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from dore.errors import InputError, number, whole
from dore.learn import keys
from dore.world.generator import InstanceSource
from dore.world.reach import Reach
from dore.world.rules import Failure, legal_moves, transition


@dataclass(frozen=True)
class Rewards:
    """The paper's reward set (r_p, r_u, r_n), Table 5.

    Raises:
        InputError: a reward is not finite, or failing pays as well as solving.
    """

    solved: float
    unfinished: float
    failed: float

    def __post_init__(self) -> None:
        for name in ("solved", "unfinished", "failed"):
            number(f"env.rewards.{name}", getattr(self, name))
        if self.solved <= self.failed:
            raise InputError(f"env.rewards: solved {self.solved:g} is not above failed {self.failed:g}")


class RearrangeEnv(EnvBase):
    """Pick an obstacle and place it elsewhere until the target is accessible (paper, sections 4 and 5).

    Observation: board Int64[B, W], target Int64[B], visited Int64[B, T, W], (pick, mask) and (place, mask)
        Bool[B, G] (see `dore.world.rules.LegalMoves`), failure Int64[B].
    Action: (pick, action) and (place, action), Int64[B] cells. Illegal ones are allowed in: they end the
        episode, as in the paper.
    Reward: (place, reward) Float[B, 1], of the whole move: r_p if the target is accessible, r_n for a failure
        or where no legal move is left, else r_u. (pick, reward) Float[B, 1], of the pick alone: r_p if the
        lift makes the target accessible, r_n if the pick fails, else r_u.
    Termination: solved, one of the four failures, or no legal move left; truncated after `max_moves`.
    State: kept on the environment, because TorchRL strips it from what it hands to a partial reset.

    Args:
        reach: says what is accessible; its device is the environment's.
        source: where episodes come from.
        num_envs: B.
        max_moves: step limit of an episode (the paper has none; going back is a failure there, so its
            episodes end too).
        rewards: (r_p, r_u, r_n).
    """

    batch_locked = True

    def __init__(self, reach: Reach, source: InstanceSource, num_envs: int, max_moves: int, rewards: Rewards) -> None:
        whole("env.num_envs", num_envs, 1)
        whole("env.max_moves", max_moves, 1)
        super().__init__(device=reach.device, batch_size=torch.Size([num_envs]))
        self.reach = reach
        self.source = source
        self.max_moves = max_moves
        self.rewards = rewards
        self._make_specs(num_envs)
        self._board = torch.zeros(num_envs, reach.n_words, dtype=torch.int64, device=self.device)
        self._target = torch.zeros(num_envs, dtype=torch.int64, device=self.device)
        self._visited = self._board[:, None].repeat(1, max_moves + 1, 1)
        self._moves = torch.zeros_like(self._target)
        self._shown: dict[str, Tensor] | None = None

    def _make_specs(self, n: int) -> None:
        cells, words, device = self.reach.n_cells, self.reach.n_words, self.device

        def per_cell() -> Composite:
            return Composite(mask=Binary(cells, shape=(n, cells), dtype=torch.bool), shape=(n,))

        def words_of(*shape: int) -> Unbounded:
            return Unbounded(shape=(n, *shape), dtype=torch.int64)

        def both(leaf: Composite) -> Composite:
            return Composite(pick=leaf, place=leaf.clone(), shape=(n,), device=device)

        self.observation_spec = Composite(
            {
                keys.BOARD: words_of(words),
                keys.TARGET: Bounded(0, cells - 1, shape=(n,), dtype=torch.int64),
                keys.VISITED: words_of(self.max_moves + 1, words),
                keys.FAILURE: Bounded(0, max(Failure), shape=(n,), dtype=torch.int64),
                "pick": per_cell(),
                "place": per_cell(),
            },
            shape=(n,),
            device=device,
        )
        self.action_spec = both(Composite(action=Categorical(cells, shape=(n,)), shape=(n,)))
        self.full_reward_spec = both(Composite(reward=Unbounded(shape=(n, 1)), shape=(n,)))
        flags = (keys.DONE, keys.TERMINATED, keys.TRUNCATED)
        self.full_done_spec = Composite(
            {flag: Binary(1, shape=(n, 1), dtype=torch.bool) for flag in flags}, shape=(n,), device=device
        )

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:
            self.source.seed(seed)

    def _observe(self, rows: Tensor | slice = slice(None)) -> tuple[dict[str, Tensor], Tensor]:
        """What those rows show (masks flat), and which of them are solved."""
        board, target, visited = self._board[rows], self._target[rows], self._visited[rows]
        legal = legal_moves(self.reach, board, target, visited)
        shown = {
            keys.BOARD: board,
            keys.TARGET: target,
            keys.VISITED: visited,
            keys.FAILURE: torch.zeros_like(target),
            "pick": legal.pick,
            "place": legal.place,
        }
        return shown, legal.solved

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: object) -> TensorDict:
        """New instances for the rows that ask; the other rows show what they showed.

        A partial reset must return every row: `ActionMask` reads its mask from here, before rows are merged.
        """
        wanted = None if tensordict is None else tensordict.get("_reset", None)
        if wanted is None or self._shown is None:
            rows = torch.arange(self.batch_size[0], device=self.device)
        else:
            rows = wanted.view(-1).nonzero().squeeze(-1)
        board, target = self.source.draw(len(rows))
        self._board = self._board.index_copy(0, rows, board)
        self._target = self._target.index_copy(0, rows, target)
        remembered = board[:, None].expand(-1, self.max_moves + 1, -1)
        self._visited = self._visited.index_copy(0, rows, remembered)
        self._moves = self._moves.index_fill(0, rows, 0)
        fresh, _ = self._observe(rows)
        if self._shown is None or len(rows) == self.batch_size[0]:
            self._shown = fresh
        else:
            self._shown = {name: old.index_copy(0, rows, fresh[name]) for name, old in self._shown.items()}
        return self._pack(self._shown, {})

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        """One pick-and-place in every row; a row's result depends on that row only."""
        pick, place = tensordict.get(keys.PICK), tensordict.get(keys.PLACE)
        outcome = transition(self.reach, self._board, self._target, self._visited, pick, place)
        self._board = outcome.board
        self._moves = self._moves + 1
        # A row that is stepped past its end, unreset, stays at its last place.
        slot = self._moves.clamp_max(self.max_moves)[:, None, None].expand(-1, 1, self.reach.n_words)
        accepted = (outcome.failure == Failure.NONE)[:, None, None]
        kept = torch.where(accepted, self._board[:, None], self._visited[:, :1])
        self._visited = self._visited.scatter(1, slot, kept)
        self._shown, solved = self._observe()
        solved = solved & (outcome.failure == Failure.NONE)
        stuck = (outcome.failure == Failure.NONE) & ~solved & ~self._shown["pick"].any(-1)
        failure = torch.where(stuck, int(Failure.NO_LEGAL_MOVE), outcome.failure)
        self._shown[keys.FAILURE] = failure
        failed = failure != Failure.NONE
        terminated = solved | failed
        truncated = (self._moves >= self.max_moves) & ~terminated
        pick_failed = (failure == Failure.PICK) | (failure == Failure.PICK_AND_PLACE)
        return self._pack(
            self._shown,
            {
                keys.DONE: terminated | truncated,
                keys.TERMINATED: terminated,
                keys.TRUNCATED: truncated,
                "pick": self._reward(outcome.opened, pick_failed),
                "place": self._reward(solved, failed),
            },
        )

    def _reward(self, solved: Tensor, failed: Tensor) -> Tensor:
        """Float[B]."""
        other = torch.where(failed, self.rewards.failed, self.rewards.unfinished)
        return torch.where(solved, self.rewards.solved, other).float()

    def _pack(self, shown: dict[str, Tensor], results: dict[str, Tensor]) -> TensorDict:
        """The TensorDict of a reset (no results) or a step; `_new_unsafe` skips what the specs check already."""
        fields: dict[str, Tensor | TensorDict] = {
            name: value for name, value in shown.items() if name not in ("pick", "place")
        }
        for head in ("pick", "place"):
            inner = {"mask": shown[head]}
            if results:
                inner["reward"] = results[head][:, None]
            fields[head] = TensorDict._new_unsafe(inner, batch_size=self.batch_size, device=self.device)
        for flag in (keys.DONE, keys.TERMINATED, keys.TRUNCATED):
            fields[flag] = (
                results[flag][:, None]
                if results
                else torch.zeros(*self.batch_size, 1, dtype=torch.bool, device=self.device)
            )
        return TensorDict._new_unsafe(fields, batch_size=self.batch_size, device=self.device)

    def observation(self) -> TensorDict:
        """What every row shows now, as a reset returns it."""
        if self._shown is None:
            raise RuntimeError("the environment has not been reset")
        return self._pack(self._shown, {})

    def state_dict(self) -> dict[str, Tensor]:  # type: ignore[override]
        """All that the next step and reset depend on, the source's state included."""
        state = {
            "board": self._board,
            "target": self._target,
            "visited": self._visited,
            "moves": self._moves,
        }
        return {**state, **{f"source.{name}": value for name, value in self.source.state_dict().items()}}

    def load_state_dict(self, state_dict: dict[str, Tensor]) -> None:  # type: ignore[override]
        """Go on as the environment whose `state_dict` this is."""
        on_device = {name: value.to(self.device) for name, value in state_dict.items() if "." not in name}
        self._board, self._target = on_device["board"], on_device["target"]
        self._visited, self._moves = on_device["visited"], on_device["moves"]
        self._shown, _ = self._observe()
        source = {name.removeprefix("source."): value for name, value in state_dict.items() if "." in name}
        self.source.load_state_dict(source)

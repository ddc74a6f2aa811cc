"""The rearrangement problem as a batched TorchRL environment: a thin shell around `dore.world.episode`."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from dore.errors import InputError, number, shown, whole
from dore.learn import keys
from dore.world.board import check_boards, integers
from dore.world.episode import MAX_MOVES, Episodes, advance, begin, resumed
from dore.world.generator import InstanceSource
from dore.world.reach import Reach
from dore.world.rules import Failure

MAX_ENVS = 100_000
LARGEST = 1e6
"""No reward is larger: float32 holds it and its fractions."""


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
            number(f"env.rewards.{name}", getattr(self, name), above=-LARGEST, at_most=LARGEST)
        if self.solved <= self.failed:
            raise InputError(f"env.rewards: solved {self.solved:g} is not above failed {self.failed:g}")

    def of(self, solved: Tensor, failed: Tensor) -> Tensor:
        """Float[B]: what a move is paid that has made the target accessible, Bool[B], or has failed, Bool[B]."""
        return torch.where(solved, self.solved, torch.where(failed, self.failed, self.unfinished)).float()


class RearrangeEnv(EnvBase):
    """Pick an obstacle and place it elsewhere until the target is accessible (paper, sections 4 and 5).

    Observation: board Int64[B, W], target Int64[B], visited Int64[B, T, W], failure Int64[B], and Bool[B, G] masks of
        the picks: (pick, legal), the legal ones, and (pick, accessible), m_p.
    Action: (pick, action) and (place, action), Int64[B] cells. Illegal ones are allowed in: they end the
        episode, as in the paper.
    Reward: (place, reward) Float[B, 1], of the whole move: r_p if the target is accessible, r_n for a failure
        or where no legal move is left, else r_u. (pick, reward) Float[B, 1], of the pick alone: r_p if the
        lift makes the target accessible, r_n if the pick fails, else r_u.
    Termination: solved, one of the four failures, or no legal move left; truncated after `max_moves`.
    State: kept on the environment, because TorchRL strips it from what it hands to a partial reset. `step` refuses
        an observation that is not the environment's own; what it returns shares no memory with the environment.

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
        num_envs = whole("env.num_envs", num_envs, 1, at_most=MAX_ENVS)
        max_moves = whole("env.max_moves", max_moves, 1, at_most=MAX_MOVES)
        super().__init__(device=reach.device, batch_size=torch.Size([num_envs]))
        if not isinstance(source, InstanceSource) or not source.reach.same_as(reach):
            got = f"instances of {source.reach}" if isinstance(source, InstanceSource) else shown(source)
            raise InputError(f"env.source: got {got}, want a source of instances of the env's reach, {reach}")
        self.reach = reach
        self.source = source
        self.max_moves = max_moves
        if not isinstance(rewards, Rewards):
            raise InputError(f"env.rewards: got {shown(rewards)}, want solved, unfinished and failed")
        self.rewards = rewards
        self._make_specs(num_envs)
        self._episodes: Episodes | None = None

    def _make_specs(self, n: int) -> None:
        cells, words, device = self.reach.n_cells, self.reach.n_words, self.device

        def mask() -> Binary:
            return Binary(cells, shape=(n, cells), dtype=torch.bool)

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
                "pick": Composite(legal=mask(), accessible=mask(), shape=(n,)),
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

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: object) -> TensorDict:
        """New instances for the rows that ask; the other rows are observed as they were.

        A partial reset must return every row: `ActionMask` reads its mask from here, before rows are merged.
        """
        wanted = None if tensordict is None else tensordict.get("_reset", None)
        if wanted is None or self._episodes is None:
            self._episodes = begin(self.reach, self.source.draw(self.batch_size[0]), self.max_moves)
        else:
            rows = wanted.view(-1).nonzero().squeeze(-1)
            fresh = begin(self.reach, self.source.draw(len(rows)), self.max_moves)
            self._episodes = self._episodes.put(rows, fresh)
        return self.observation()

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        """One pick-and-place in every row; a row's result depends on that row only.

        Raises:
            InputError: an observation that is not the environment's own, or an action that is no cell; integers of any
                width are cells.
        """
        self._check_own(tensordict)
        pick, place = self._cells(tensordict, keys.PICK), self._cells(tensordict, keys.PLACE)
        self._episodes, opened = advance(self.reach, self._under_way(), pick, place)
        solved, failure = self._episodes.solved, self._episodes.failure
        failed = failure != Failure.NONE
        terminated = solved | failed
        truncated = (self._episodes.steps >= self.max_moves) & ~terminated
        pick_failed = (failure == Failure.PICK) | (failure == Failure.PICK_AND_PLACE)
        return self._pack(
            {keys.DONE: terminated | truncated, keys.TERMINATED: terminated, keys.TRUNCATED: truncated},
            {"pick": self.rewards.of(opened, pick_failed), "place": self.rewards.of(solved, failed)},
        )

    def _cells(self, tensordict: TensorDictBase, key: keys.Key) -> Tensor:
        """Int64[B]: the cells of one action."""
        cell = tensordict.get(key, None)
        name = f"env.step: {'.'.join(key)}"
        if cell is None or cell.shape != self.batch_size:
            got = "none" if cell is None else f"{list(cell.shape)}"
            raise InputError(f"{name}: got {got}, want {list(self.batch_size)} cells")
        cell = integers(name, cell, self.device)
        if bool(((cell < 0) | (cell >= self.reach.n_cells)).any()):
            got = f"{int(cell.min())} to {int(cell.max())}"
            raise InputError(f"{name}: got cells {got}, want 0 to {self.reach.n_cells - 1}")
        return cell

    def _check_own(self, tensordict: TensorDictBase) -> None:
        """Refuse an observation of other boards: `step` continues from the environment's own."""
        episodes = self._under_way()
        own = ((keys.BOARD, episodes.board), (keys.TARGET, episodes.target), (keys.VISITED, episodes.visited))
        for name, value in own:
            given = tensordict.get(name, None)
            if given is not None and not torch.equal(given, value):
                raise InputError(
                    f"env.step: {name}: got another one than the environment's, want what reset or step returned"
                )

    def _pack(self, flags: dict[str, Tensor], rewards: dict[str, Tensor]) -> TensorDict:
        """The TensorDict of a reset (no rewards) or a step; `_new_unsafe` skips what the specs check already."""
        episodes = self._under_way()

        def nested(leaves: dict[str, Tensor]) -> TensorDict:
            return TensorDict._new_unsafe(leaves, batch_size=self.batch_size, device=self.device)

        # Copies: a caller may write into what it was given.
        observed = {
            keys.BOARD: episodes.board.clone(),
            keys.TARGET: episodes.target.clone(),
            keys.VISITED: episodes.visited.clone(),
            keys.FAILURE: episodes.failure.clone(),
        }
        heads = {"pick": {"legal": episodes.legal.pick.clone(), "accessible": episodes.legal.pickable.clone()}}
        for head, reward in rewards.items():
            heads.setdefault(head, {})["reward"] = reward[:, None]
        ends = {name: flag[:, None] for name, flag in flags.items()}
        fields = {**observed, **ends, **{head: nested(leaves) for head, leaves in heads.items()}}
        return TensorDict._new_unsafe(fields, batch_size=self.batch_size, device=self.device)

    def _under_way(self) -> Episodes:
        if self._episodes is None:
            raise RuntimeError("the environment has not been reset")
        return self._episodes

    def observation(self) -> TensorDict:
        """What every row observes now, as a reset returns it."""
        off = (torch.zeros(self.batch_size, dtype=torch.bool, device=self.device) for _ in range(3))
        return self._pack(dict(zip((keys.DONE, keys.TERMINATED, keys.TRUNCATED), off, strict=True)), {})

    def state_dict(self) -> dict[str, Tensor]:  # type: ignore[override]
        """All that the next step and reset depend on, the source's state included."""
        episodes = self._under_way()
        state = {
            "board": episodes.board,
            "target": episodes.target,
            "visited": episodes.visited,
            "moves": episodes.steps,
        }
        return {**state, **{f"source.{name}": value for name, value in self.source.state_dict().items()}}

    def load_state_dict(self, state_dict: dict[str, Tensor]) -> None:  # type: ignore[override]
        """Continue as the environment whose `state_dict` this is.

        Raises:
            InputError: a part is missing, or is not one of an environment of this size, layout and step limit.
        """
        state = {name: self._part(state_dict, name) for name in ("board", "target", "visited", "moves")}
        check_boards("env.state_dict: board", state["board"], state["target"], self.reach.n_cells)
        source = {name.removeprefix("source."): value for name, value in state_dict.items() if "." in name}
        self.source.load_state_dict(source)
        self._episodes = resumed(self.reach, *state.values())

    def _part(self, state_dict: dict[str, Tensor], name: str) -> Tensor:
        """A copy of one tensor of a saved state."""
        specs = {**self.observation_spec, "moves": Bounded(0, self.max_moves + 1, self.batch_size, dtype=torch.int64)}
        part, spec = state_dict.get(name), specs[name]
        if not isinstance(part, Tensor) or (part.dtype, part.shape) != (spec.dtype, spec.shape):
            got = f"{part.dtype}{list(part.shape)}" if isinstance(part, Tensor) else shown(part)
            raise InputError(f"env.state_dict: {name}: got {got}, want {spec.dtype}{list(spec.shape)} of this env")
        copied = part.to(self.device, copy=True)
        if not spec.is_in(copied):
            wanted = f"{int(spec.space.low.min())} to {int(spec.space.high.max())}"
            raise InputError(f"env.state_dict: {name}: got {int(part.min())} to {int(part.max())}, want {wanted}")
        return copied

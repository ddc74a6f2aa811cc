"""The page of the boards that are left: how they end, how far they are from solved, and what explains them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import torch

from dore.files import commit
from dore.report.estimates import Estimate, share
from dore.report.tables import Table, as_markdown
from scripts.failures_found import PROOF_S, Board, Column

ENDINGS = {"move budget": "step limit", "no legal move": "no legal move left"}


def page(columns: Sequence[Column], model: str, command: str, picture: str | None) -> list[str]:
    """The Markdown, line by line. picture: its name, None where there is nothing to draw."""
    lines = [
        "# The failures that are left",
        "",
        f"`{command}`, commit {commit()}, torch {torch.__version__}, weights `{model}`, seed 0 of the instances, reach "
        f"wide_hand. Boards of the validation split. `learned` is the network's greedy choices; a board can be solved "
        f"where `exact` proves the fewest moves within {PROOF_S:g} s of its own. `now` is the corridor cost of the "
        "start board (`dore.learn.corridor_features.corridor_costs`), estimated from two levels of corridors: what "
        "blocks a corridor of the target, and what blocks the hand from that. The network sees the distance "
        "through these costs.",
    ]
    if picture:
        lines += [
            "",
            f"![Failing boards: a shortest plan's next move, and the network's]({picture})",
            "",
            "The first of the failing boards, at the first move of the network's that does not bring the end nearer: "
            "left a shortest plan's move, right the network's.",
        ]
    for column in columns:
        lines += ["", f"## {column.title}", "", *_section(column)]
    return lines


def _section(column: Column) -> list[str]:
    failed, boards = column.failed, column.boards
    head = (
        f"{column.drawn} boards, {len(boards)} can be solved, {column.undecided} are undecided. The network fails on "
        f"{len(failed)} of those that can be solved: {_percent(share(len(failed), len(boards)))} %."
    )
    if not failed:
        return [head]
    return [
        head,
        "",
        explanation(boards),
        "",
        as_markdown(_over(boards, "optimum − now", lambda board: board.optimum - board.now)),
        "",
        as_markdown(_over(boards, "optimum", lambda board: board.optimum)),
        "",
        as_markdown(_endings(failed)),
        "",
        *_mistakes(failed),
    ]


def explanation(boards: Sequence[Board]) -> str:
    """Whether a cost that promises too much explains the failures, in words that the numbers choose."""
    failed = [board for board in boards if board.ending]
    above, below = [one for one in boards if one.above], [one for one in boards if not one.above]
    lost = sum(board.above for board in failed)
    of_failed, of_all = share(lost, len(failed)), share(len(above), len(boards))
    rate, other = share(lost, len(above)), share(len(failed) - lost, len(below))
    counted = (
        f"The optimum is above `now` on {lost} of {len(failed)} failures ({_percent(of_failed)} %), and on "
        f"{len(above)} of all {len(boards)} boards ({_percent(of_all)} %). The network fails on {_percent(rate)} % of "
        f"such boards, and on {_percent(other)} % of the others"
    )
    counted += f": {rate.mean / other.mean:,.0f} times as often." if other.mean and rate.mean else "."
    if of_failed.low > of_all.high and of_failed.mean > 0.5:
        return (
            f"{counted} So this is what most failures are: the costs, which look two levels of lanes deep, promise "
            "progress that is not there, and the network, which sees the distance through them, wanders."
        )
    if of_failed.low > of_all.high:
        return f"{counted} So costs that promise too much explain a part of the failures, though not most."
    return f"{counted} So costs that promise too much do not explain the failures."


def _over(boards: Sequence[Board], name: str, value: Callable[[Board], int]) -> Table:
    """Boards and failures by a number of the board's."""
    every, failed = Counter(map(value, boards)), Counter(value(board) for board in boards if board.ending)
    rows = [
        [
            str(one),
            str(every[one]),
            _share(every[one], every.total()),
            str(failed[one]),
            _share(failed[one], failed.total()),
            _percent(share(failed[one], every[one])),
        ]
        for one in sorted(every)
    ]
    return [[name, "boards", "% of boards", "failures", "% of failures", "fails on %"], *rows]


def _endings(failed: Sequence[Board]) -> Table:
    counts = Counter(ENDINGS.get(board.ending, board.ending) for board in failed)
    return [["how they end", "failures", "%"], *_counted(counts)]


def _mistakes(failed: Sequence[Board]) -> list[str]:
    """Where the plans first lose ground, and how much."""
    mistakes = [board.mistake for board in failed if board.mistake is not None]
    if not mistakes:
        return []
    above = sum(one.optimum > one.now for one in mistakes)
    numbers = Counter(f"move {one.number}" if one.number < 4 else "move 4 or later" for one in mistakes)
    after = Counter(_lost(one.optimum, one.after) for one in mistakes)
    return [
        f"The first move after which no plan of one move fewer is proved; on {above} of these {len(mistakes)} boards "
        f"({_percent(share(above, len(mistakes)))} %) the optimum is above `now` when it is made.",
        "",
        as_markdown([["first such move", "failures", "%"], *_counted(numbers)]),
        "",
        as_markdown([["what it costs", "failures", "%"], *_counted(after)]),
    ]


def _lost(before: int, after: int | None) -> str:
    """What a move cost, beside itself."""
    if after is None:
        return "no plan is left, or none is proved in time"
    return {0: "a move: the distance stays", 1: "two moves: one farther away"}.get(after - before, "three or more")


def _counted(counts: Counter[str]) -> Iterable[list[str]]:
    return ([name, str(n), _share(n, counts.total())] for name, n in sorted(counts.items()))


def _share(part: int, whole: int) -> str:
    return f"{100 * part / whole:.1f}" if whole else "-"


def _percent(share: Estimate) -> str:
    """`83.8 [75.4, 89.8]`."""
    if share.mean != share.mean:
        return "-"
    return f"{100 * share.mean:.1f} [{100 * share.low:.1f}, {100 * share.high:.1f}]"

"""The sensitivity study's page, made from its rows alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import yaml

from dore.files import atomic_write, commit, conf_dir
from dore.report.tables import Table, as_markdown
from scripts.paper_rows import REARRANGEMENTS
from scripts.reach_sensitivity_figure import draw
from scripts.reach_sensitivity_rows import (
    CHECK,
    GRID,
    Distance,
    Fit,
    Point,
    Row,
    distances,
    fits,
    nearest,
    read_rows,
    write_rows,
)

SHOWN = 10
"""Points in the table of the nearest."""


def write_report(csv: Path, report: Path, command: str) -> None:
    """Write REPORT.csv, REPORT.png and REPORT.md.

    Raises:
        InputError: a CSV that cannot be read, or in which no point can be compared.
    """
    rows = read_rows(csv)
    found = distances(row for row in rows if row.stage == GRID)
    known, best = fits(found), nearest(found)
    check = [row for row in rows if row.stage == CHECK and row.point == best]
    report.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(report.with_suffix(".png"), "wb") as file:
        draw(file, found, best, check)
    sections = [
        *_opening(rows, command),
        *_nearest(best, found, known, check),
        f"![Distances over the grid, and the nearest point beside the paper's rows]({report.name}.png)",
        "",
        *_ranking(found, known, best, _solved(rows)),
        *_optimum(found),
    ]
    with atomic_write(report.with_suffix(".md")) as file:
        file.write("\n".join(sections))
    if csv.resolve() != report.with_suffix(".csv").resolve():
        write_rows(report.with_suffix(".csv"), rows)


def _opening(rows: Sequence[Row], command: str) -> list[str]:
    first = rows[0]
    reaches = {row.point[:2] for row in rows}
    corridors = {row.point[2:] for row in rows if row.stage == GRID}
    return [
        "# Where the paper is silent: reach and corridor",
        "",
        f"`{command}`, commit {commit()}, seed {first.seed}, validation split, start of the hand at the base.",
        "",
        f"{len(reaches)} reaches x {len(corridors)} corridors on {' and '.join(REARRANGEMENTS)}. The proved optimum on "
        f"{first.optimum_n} instances a column, the baseline on the first {first.baseline_n} of them. Distances are "
        "root mean squares over the columns, in rearrangements: of the optimum's mean from the paper's DQN row, and of "
        "the baseline's mean from the paper's baseline row. The optimum's mean is over all instances that can be "
        "solved, as transfer learning solves what the DQN does not; the baseline's over those that both solve.",
        "",
        "The joint distance weighs the two rows alike: each is pooled over both boards and divided by the least that "
        "any point of the grid reaches, then the root mean square is taken. Undivided (column plain), the row that no "
        "point comes near would decide alone. This weighing was chosen after the plain distance had been seen to "
        "pick a point far from the DQN row, and the grid was widened once, as its nearest point had lain on its edge.",
        "",
    ]


def _nearest(
    best: Point, found: Mapping[Point, Mapping[str, Distance]], known: Mapping[Point, Fit], check: Sequence[Row]
) -> list[str]:
    apart = [f"{board}: {one.dqn:.2f} and {one.baseline:.2f}" for board, one in found[best].items()]
    again = [f"{board}: {one.dqn:.2f} and {one.baseline:.2f}" for board, one in distances(check)[best].items()]
    return [
        "## The nearest point: `reach=paper_fit`",
        "",
        f"It is {_named(best)}. Distances from the DQN row and from the baseline row: {', '.join(apart)}. Once more, "
        f"on {check[0].optimum_n} instances a column of seed {check[0].seed} for both planners: {', '.join(again)}. "
        "The points ranked next to it differ by less than such a change of instances does.",
        "",
        "How near any point comes, over both boards:",
        "",
        *_extremes(found, known),
        "",
        "Of crowded boards our baseline solves the easier ones only, and its mean is over these. The paper has an "
        "entry in every column and does not say that its baseline failed.",
        "",
        "The nearest point, those instances, by obstacles: means with half their 95 % intervals (the paper's from its "
        "sd and 10 repetitions).",
        "",
        as_markdown(_columns(check)),
        "",
    ]


def _extremes(found: Mapping[Point, Mapping[str, Distance]], known: Mapping[Point, Fit]) -> list[str]:
    """What other ways of weighing would have picked."""
    narrow = {
        point: {at: one._replace(dqn=one.dqn_both) for at, one in boards.items()} for point, boards in found.items()
    }
    least = [
        ("Nearest to the DQN row", known, min(known, key=lambda point: known[point].dqn)),
        ("Nearest to the baseline row", known, min(known, key=lambda point: known[point].baseline)),
        ("Least plain distance", known, min(known, key=lambda point: known[point].plain)),
        ("Least joint distance, were the optimum's mean too over what both solve", fits(narrow), nearest(narrow)),
    ]
    return [
        f"- {what}: {_named(point)}; {fit[point].dqn:.2f} from the DQN row, {fit[point].baseline:.2f} from the "
        "baseline row."
        for what, fit, point in least
    ]


def _columns(check: Sequence[Row]) -> Table:
    """The nearest point's rows beside the paper's, a column for each number of obstacles."""
    obstacles = sorted({row.obstacles for row in check})
    table: Table = [["", *map(str, obstacles)]]
    for board, paper in REARRANGEMENTS.items():
        columns = [row for row in check if row.board == board]
        table += [
            [
                f"{board}: the paper's DQN",
                *[_spread(paper["dqn"][z].mean, paper["dqn"][z].half95, 1) for z in obstacles],
            ],
            ["optimum", *[_spread(row.optimum_mean, row.optimum_high - row.optimum_mean, 2) for row in columns]],
            ["can be solved, %", *[f"{100 * row.optimum_solved:.0f}" for row in columns]],
            ["optimum, where both solve", *[f"{row.both_optimum_mean:.2f}" for row in columns]],
            [
                "the paper's baseline",
                *[_spread(paper["baseline"][z].mean, paper["baseline"][z].half95, 1) for z in obstacles],
            ],
            ["baseline", *[_spread(row.baseline_mean, row.baseline_high - row.baseline_mean, 2) for row in columns]],
            ["baseline solves, %", *[f"{100 * row.baseline_solved:.0f}" for row in columns]],
        ]
    return table


def _ranking(
    found: Mapping[Point, Mapping[str, Distance]], known: Mapping[Point, Fit], best: Point, solved: Mapping[Point, str]
) -> list[str]:
    """The nearest points, and every preset that lies on the grid with the default corridor."""
    ranked = sorted(known, key=lambda point: known[point].joint)
    presets = _presets()
    plain = min(known, key=lambda point: known[point].plain)
    default = [point for point in ranked if point[:2] in presets and point[2:] == (None, False)]
    shown = [point for place, point in enumerate(ranked) if place < SHOWN or point == plain or point in default]
    boards = list(found[best])
    header = ["rank", "clearance, m", "half fan, deg", "corridor, m", "avoids", "joint", "plain"]
    header += [f"{board} {what}" for board in boards for what in ("DQN", "baseline", "DQN, both solve", "above")]
    table: Table = [[*header, "baseline solves, %", "preset"]]
    for point in shown:
        cells = [f"{ranked.index(point) + 1}", f"{point.clearance_m:g}", f"{point.half_fan_deg:g}", _corridor(point)]
        cells += ["yes" if point.avoid_corridors else "no", f"{known[point].joint:.2f}", f"{known[point].plain:.2f}"]
        for board in boards:
            one = found[point][board]
            cells += [f"{one.dqn:.2f}", f"{one.baseline:.2f}", f"{one.dqn_both:.2f}", str(one.above)]
        preset = presets.get(point[:2], "") if point in (best, *default) else ""
        table.append([*cells, solved[point], preset])
    return [
        "## Points by joint distance",
        "",
        f"{len(known)} of {len(found)} points have instances that both planners solve in every column. Above: columns "
        "in which the optimum exceeds the paper's DQN by more than the 95 % interval of the difference, which no DQN "
        "could go below. Baseline solves: over all columns, by board.",
        "",
        as_markdown(table),
        "",
    ]


def _optimum(found: Mapping[Point, Mapping[str, Distance]]) -> list[str]:
    reaches: dict[tuple[float, float], Mapping[str, Distance]] = {}
    for point, boards in found.items():
        reaches.setdefault((point.clearance_m, point.half_fan_deg), boards)
    clearances, fans = ({reach[axis] for reach in reaches} for axis in (0, 1))
    table: Table = [["clearance, m", *[f"{fan:g} deg" for fan in sorted(fans)]]]
    for clearance in sorted(clearances):
        cells = [reaches[clearance, fan] for fan in sorted(fans)]
        table.append(
            [f"{clearance:g}"] + [" / ".join(f"{one.dqn:.2f}" + "↑" * one.above for one in at.values()) for at in cells]
        )
    return [
        "## The optimum alone, over every reach",
        "",
        f"Distance from the DQN row, {' / '.join(REARRANGEMENTS)}; an arrow for each column in which the optimum is "
        "above the paper's DQN by more than the 95 % interval.",
        "",
        as_markdown(table),
        "",
    ]


def _solved(rows: Iterable[Row]) -> dict[Point, str]:
    """Of each point the shares of the instances that the baseline solves, one a board."""
    shares: dict[Point, dict[str, list[float]]] = {}
    for row in rows:
        if row.stage == GRID:
            shares.setdefault(row.point, {}).setdefault(row.board, []).append(row.baseline_solved)
    return {
        point: " / ".join(f"{100 * sum(one) / len(one):.0f}" for one in boards.values())
        for point, boards in shares.items()
    }


def _presets() -> dict[tuple[float, float], str]:
    """The names of conf/reach by clearance and fan; a preset that is more than these is not on the grid."""
    named = {}
    for path in sorted((conf_dir() / "reach").glob("*.yaml")):
        keys = yaml.safe_load(path.read_text(encoding="utf-8"))
        if set(keys) == {"_target_", "clearance_m", "half_fan_deg", "n_sectors"}:
            named[keys["clearance_m"], keys["half_fan_deg"]] = path.stem
    return named


def _named(point: Point) -> str:
    avoids = ", corridors avoided" if point.avoid_corridors else ""
    return (
        f"clearance {point.clearance_m:g} m, half fan {point.half_fan_deg:g} deg, corridor {_corridor(point)}"
        f"{' m' if point.corridor_m is not None else ''}{avoids}"
    )


def _corridor(point: Point) -> str:
    return "as clearance" if point.corridor_m is None else f"{point.corridor_m:g}"


def _spread(mean: float, half: float, digits: int) -> str:
    return f"{mean:.{digits}f} ± {half:.{digits}f}"

"""Rules that turn a good scene or plan file into nonsense: each of them must be refused, whatever the dice say."""

from __future__ import annotations

import json
from collections.abc import Callable
from random import Random
from typing import Any

Spoil = Callable[[str, Random], str]
Change = Callable[[dict[str, Any], Random], None]


def _changed(change: Change) -> Spoil:
    def spoil(text: str, random: Random) -> str:
        data = json.loads(text)
        change(data, random)
        return json.dumps(data)

    return spoil


def _unit(group: str, key: str) -> Change:
    """A length in centimetres or millimetres, give or take."""

    def change(data: dict[str, Any], random: Random) -> None:
        data[group][key] *= random.choice((100, 1000)) * random.uniform(0.9, 1.1)

    return change


def _twice(text: str, random: Random) -> str:
    """A key that is given twice."""
    data = json.loads(text)
    key = random.choice(list(data))
    return text.replace("{", f'{{"{key}": {json.dumps(data[key])},', 1)


def _unknown(data: dict[str, Any], random: Random) -> None:
    node = random.choice([data, *(value for value in data.values() if isinstance(value, dict))])
    key = random.choice(list(node))
    node[random.choice((key + "s", key[:-1], key.upper(), f"_{key}", "comment"))] = node[key]


def _missing(data: dict[str, Any], random: Random) -> None:
    # The front edge has a default, and so do these of a plan.
    del data[random.choice([key for key in data if key not in ("planning_s", "optimal_moves", "base_frame")])]


def _outside(data: dict[str, Any], random: Random) -> None:
    cell = random.choice((0, -1, data["layout"]["rows"] * data["layout"]["cols"] + random.randrange(1, 9), 2**40))
    if random.random() < 0.5:
        data["target"] = cell
    else:
        data["obstacles"][random.randrange(len(data["obstacles"]))] = cell


def _fraction(data: dict[str, Any], random: Random) -> None:
    place = random.randrange(len(data["obstacles"]))
    data["obstacles"][place] = random.choice(
        (data["obstacles"][place] + 0.5, str(data["obstacles"][place]), True, None)
    )


def _same_cell(data: dict[str, Any], random: Random) -> None:
    data["obstacles"].append(random.choice([*data["obstacles"], data["target"]]))


def _near_cells(data: dict[str, Any], random: Random) -> None:
    gap = random.uniform(0.0, 0.068)
    data["layout"] = {"cells": [[0.5 + 0.15 * i, 0.0] for i in range(18)], "cell_m": 0.12}
    data["layout"]["cells"][random.randrange(1, 18)] = [0.5, gap]


def _behind(data: dict[str, Any], random: Random) -> None:
    data["layout"]["front_m"] = -random.uniform(0.01, 2.0)


def _wrong_type(data: dict[str, Any], random: Random) -> None:
    key = random.choice(["layout", "obstacles", "target", "format"])
    data[key] = random.choice((None, "x", 1.5, {"a": 1}, [[]], True))


def _no_solution(data: dict[str, Any], random: Random) -> None:
    data["status"] = "unsolvable"
    if random.random() < 0.5:
        data["target_direction_deg"] = None


def _too_good(data: dict[str, Any], random: Random) -> None:
    data["optimal_moves"] = len(data["moves"]) + random.randrange(1, 50)


def _no_target(data: dict[str, Any], random: Random) -> None:
    data["target_direction_deg"] = None


def _shuffled(data: dict[str, Any], random: Random) -> None:
    data["moves"].append(data["moves"][random.randrange(len(data["moves"]))])


def _turned(data: dict[str, Any], random: Random) -> None:
    move, key = random.choice(data["moves"]), random.choice(("pick_direction_deg", "place_direction_deg"))
    move[key] = random.choice((-1, 1)) * random.uniform(data["reach"]["half_fan_deg"] + 1, 400)


def _negative(data: dict[str, Any], random: Random) -> None:
    data["planning_s"] = -random.uniform(0.1, 9)


def _huge_table(data: dict[str, Any], random: Random) -> None:
    data["reach"]["n_sectors"] = random.choice((10**6, 721, 10**18, 0, 1, -5))


RULES: dict[str, tuple[str, Spoil]] = {
    "a length in centimetres or millimetres: cell_m": ("scenes", _changed(_unit("layout", "cell_m"))),
    "a length in centimetres or millimetres: clearance_m": ("plans", _changed(_unit("reach", "clearance_m"))),
    "a key given twice": ("plans", _twice),
    "an unknown key": ("plans", _changed(_unknown)),
    "a missing key": ("plans", _changed(_missing)),
    "a cell off the board": ("scenes", _changed(_outside)),
    "a cell that is no whole number": ("scenes", _changed(_fraction)),
    "two objects on a cell": ("scenes", _changed(_same_cell)),
    "cells nearer than objects are wide": ("scenes", _changed(_near_cells)),
    "a table behind the robot": ("scenes", _changed(_behind)),
    "a wrong type": ("scenes", _changed(_wrong_type)),
    "unsolvable, with moves": ("plans", _changed(_no_solution)),
    "an optimum above the plan's length": ("plans", _changed(_too_good)),
    "solved, without a direction to the target": ("plans", _changed(_no_target)),
    "a move that is made twice": ("plans", _changed(_shuffled)),
    "a direction outside the fan": ("plans", _changed(_turned)),
    "a negative time": ("plans", _changed(_negative)),
    "a number of sectors out of bounds": ("plans", _changed(_huge_table)),
}
"""Which file each rule spoils, and how."""

"""Checks of values that the settings of the camera and of the film share."""

from __future__ import annotations

from dore.errors import InputError, number, whole


def check_picture(name: str, width_px: object, height_px: object, field_of_view_deg: object) -> None:
    """Refuse a picture below 16 or above 4096 pixels to a side, or a field of view outside (0, 170] degrees.

    Raises:
        InputError: names the key in the section `name`.
    """
    whole(f"{name}.width_px", width_px, 16, at_most=4096)
    whole(f"{name}.height_px", height_px, 16, at_most=4096)
    number(f"{name}.field_of_view_deg", field_of_view_deg, above=0.0, at_most=170.0)


def number_list(name: str, values: object, wanted: tuple[str, ...], most: float = 100.0) -> list[float]:
    """`values` as finite floats in (-most, most], one for each name in `wanted`.

    Raises:
        InputError: not a list, of another length, or with something else in it.
    """
    if not isinstance(values, list | tuple) or len(values) != len(wanted):
        raise InputError(f"{name}: got {values!r}, want [{', '.join(wanted)}]")
    return [number(name, value, above=-most, at_most=most) for value in values]

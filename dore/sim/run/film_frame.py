"""A frame of the film: the rendered picture, beside it the board and what has happened, below it one line of text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.typing import ColorType
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dore.draw.boards import Panel, panel_pixels
from dore.draw.style import FAINT, INK
from dore.files import atomic_write

Pixels = NDArray[np.uint8]
PANEL_SHARE = 0.8
"""Width of the panel, in heights of the picture."""
STRIP_SHARE, TEXT_SHARE, LOG_TEXT_SHARE = 0.085, 0.040, 0.029
"""Heights of the caption's strip, of its text, and of the text beside the picture, in heights of the picture."""
BOARD_SHARE = 0.8
"""Height of the board at most, in heights of the picture; the rest is for what has happened."""
SMALLEST_BOARD_PX = 200
"""A narrower board is drawn larger and scaled down: no font is that small."""
SMALLEST_TEXT = 0.6
"""A caption that does not fit is set smaller, down to this share of its size, and then cut off."""
BLOCK_PX = 8
"""Encoders want both sides of a frame to be multiples of this."""


class FilmFrame:
    """Puts frames together. The board is drawn once a move, the text once a frame.

    Args:
        width_px: of the picture.
        height_px: of the picture.
    """

    def __init__(self, width_px: int, height_px: int) -> None:
        self._width, self._height = width_px, height_px
        self._panel_width = round(PANEL_SHARE * height_px)
        size = (_blocks(width_px + self._panel_width), _blocks(height_px + round(STRIP_SHARE * height_px)))
        self._sheet = Image.new("RGB", size, "white")
        self._board: Image.Image | None = None
        self._lines: list[tuple[str, str]] = []

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame, pixels; multiples of 8."""
        return self._sheet.size

    def show_board(self, panel: Panel, colours: Mapping[int, ColorType]) -> None:
        """Draw this board from now on. colours: of the objects on these cells, in place of the usual ones."""
        room = self._panel_width - 2 * (self._panel_width // 32)
        larger = math.ceil(SMALLEST_BOARD_PX / room)
        pixels = panel_pixels(panel, larger * room, round(larger * BOARD_SHARE * self._height), colours)
        self._board = Image.fromarray(pixels).reduce(larger)
        self._draw_panel()

    def add_line(self, line: str, clock: str) -> None:
        """Add a line to what has happened, under the board; the newest stay where not all fit."""
        self._lines.append((line, clock))
        self._draw_panel()

    def frame(self, picture: Pixels, caption: str, clock: str) -> Pixels:
        """UInt8[H, W, 3], of `size`. picture: UInt8[height_px, width_px, 3]; clock: what stands at the right."""
        self._sheet.paste(Image.fromarray(picture), (0, 0))
        left, right, top = self._height // 32, self.size[0] - self._height // 32, self._height
        draw = ImageDraw.Draw(self._sheet)
        draw.rectangle((0, top, *self.size), fill="white")
        middle, text_px = (top + self.size[1]) // 2, TEXT_SHARE * self._height
        font = _font(text_px)
        draw.text((right, middle), clock, FAINT, font, "rm")
        room = right - left - font.getlength(clock) - text_px
        caption, font = _fitted(caption, text_px, room)
        draw.text((left, middle), caption, INK, font, "lm")
        return np.array(self._sheet)

    def _draw_panel(self) -> None:
        """The board at the top of the panel, and under it what has happened."""
        draw, edge = ImageDraw.Draw(self._sheet), self._panel_width // 32
        left, right, below = self._width + edge, self._width + self._panel_width - edge, edge
        draw.rectangle((self._width, 0, self.size[0], self._height), fill="white")
        if self._board is not None:
            self._sheet.paste(self._board, (left, edge))
            below += self._board.height + 2 * edge
        font = _font(LOG_TEXT_SHARE * self._height)
        line_px, indent = round(1.5 * font.size), font.size
        room = right - left - indent - font.getlength("00000.0 s")
        rows: list[tuple[float, str, str]] = []
        for line, clock in self._lines:
            first, *others = _wrapped(line, font, room)
            rows += [(left, first, clock), *((left + indent, other, "") for other in others)]
        fitting = max(0, (self._height - below) // line_px)
        for row, (start, line, clock) in enumerate(rows[len(rows) - min(fitting, len(rows)) :]):
            middle = below + row * line_px + line_px // 2
            draw.text((start, middle), line, INK, font, "lm")
            draw.text((right, middle), clock, FAINT, font, "rm")


def save_png(frame: Pixels, path: Path) -> None:
    """Write a frame whole or not at all.

    Raises:
        OSError: the disk is full or read-only.
    """
    with atomic_write(path, "wb") as file:
        Image.fromarray(frame).save(file, format="png", optimize=True)


def _blocks(length_px: int) -> int:
    return math.ceil(length_px / BLOCK_PX) * BLOCK_PX


def _font(size_px: float) -> ImageFont.FreeTypeFont:
    """The font of matplotlib's pictures, so that board and text go together."""
    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", max(1.0, size_px))


def _fitted(text: str, size_px: float, room_px: float) -> tuple[str, ImageFont.FreeTypeFont]:
    """The text and a font in which it is no wider than `room_px`: smaller, and cut off where that is not enough."""
    font = _font(size_px)
    length = font.getlength(text)
    if length <= room_px:
        return text, font
    font = _font(size_px * max(SMALLEST_TEXT, room_px / length))
    if font.getlength(text) > room_px:
        while text and font.getlength(f"{text}…") > room_px:
            text = text[:-1]
        text = f"{text.rstrip()}…"
    return text, font


def _wrapped(text: str, font: ImageFont.FreeTypeFont, room_px: float) -> list[str]:
    """The text in lines no wider than `room_px`, broken between words; one line at least."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > room_px:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines

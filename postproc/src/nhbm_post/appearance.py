"""The appearance of pictures, set by options: for a screen, with headings, or for a paper, where the caption contains them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

PAPER_WIDTH = {1: 90.0, 2: 180.0}  # [mm] of a column, and of a page of two


@dataclass(frozen=True)
class Appearance:
    """`title` replaces that of the picture; `width` [mm]; `is_paper`: no heading, small type; `settings` of matplotlib."""

    title: str | None = None
    width: float | None = None
    is_paper: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_scaled(self) -> bool:
        return self.is_paper or self.width is not None

    def scale(self, width: float, n_columns: int = 1) -> float:
        """Scale factor of a picture with a width in inches."""
        wanted = self.width or (PAPER_WIDTH[n_columns] if self.is_paper else None)
        return wanted / 25.4 / width if wanted else 1.0


_PLAIN = Appearance()
_chosen: ContextVar[Appearance] = ContextVar("appearance", default=_PLAIN)


def chosen() -> Appearance:
    """The present appearance of pictures."""
    return _chosen.get()


@contextmanager
def appearance(
    title: str | None = None, width: float | None = None, is_paper: bool = False, settings: Mapping[str, Any] | None = None
) -> Iterator[None]:
    """Context in which pictures are drawn and saved with this appearance."""
    token = _chosen.set(Appearance(title, width, is_paper, settings or {}))
    try:
        yield
    finally:
        _chosen.reset(token)

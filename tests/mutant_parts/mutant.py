"""A mutant: one small wrong change, and the unit suites that must notice it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mutant:
    """A text that stands once in a file, and what takes its place."""

    name: str
    file: str
    old: str
    new: str
    suites: tuple[str, ...]  # each must fail
    wrong: str  # what the change makes wrong


def of(file: str, *mutants: tuple[str, str, str, str, str]) -> list[Mutant]:
    """Mutants of one file: name, suites, what is wrong, old text, new text."""
    return [Mutant(name, f"src/{file}", old, new, tuple(suites.split()), wrong) for name, suites, wrong, old, new in mutants]

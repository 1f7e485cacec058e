"""Draws small wrong changes of the Fortran sources at random: operators, signs, bounds, indices, constants, comparisons, logic."""

from __future__ import annotations

import random
import re
from dataclasses import dataclass
from pathlib import Path

HEADINGS = re.compile(
    r"((use|module|submodule|contains|implicit|private|public|import|interface|abstract|procedure|generic|end|select|case|class"
    r"|return|cycle|exit|include|else)\b(?! ?if)|type\b(?! = )|([a-z][\w (),=:*]*\b)?(subroutine|function) \w+)"
)
DECLARATION = re.compile(r"(real|integer|logical|complex|character|class|type|procedure)\b[^!]*::")
NUMBER = r"(?<![\w.%])(\d+\.\d*(?:[ed][+-]?\d+)?(?:_\w+)?|\d+(?:_\w+)?)(?![\w.])"


@dataclass(frozen=True)
class Draw:
    """A part of a line, and what takes its place."""

    file: str
    line: int  # from 1
    column: int  # from 0
    old: str
    new: str
    kind: str

    def applied_to(self, text: str) -> str:
        lines = text.split("\n")
        line = lines[self.line - 1]
        assert line.startswith(self.old, self.column), "the source has changed"
        lines[self.line - 1] = line[: self.column] + self.new + line[self.column + len(self.old) :]
        return "\n".join(lines)


def draws(root: Path, count: int, seed: int, only: str = ""):
    """Different ones: a module by its lines of code, a place in it, what takes its place. Some may not build. `only` is a regular
    expression for the names of modules."""
    files = {path: sites(path, root) for path in sorted((root / "src").rglob("*.f90")) if re.search(only, path.stem)}
    files = {path: found for path, found in files.items() if found}
    weights = [lines_of_code(path) for path in files]
    chance = random.Random(seed)
    drawn = set()
    while len(drawn) < count:
        draw = chance.choice(chance.choice(files[chance.choices(list(files), weights)[0]]))
        if (draw.file, draw.line, draw.column) not in drawn:
            drawn.add((draw.file, draw.line, draw.column))
            yield draw


def lines_of_code(path: Path) -> int:
    return sum(bool(line.strip()) and not line.lstrip().startswith("!") for line in path.read_text(encoding="utf-8").splitlines())


def sites(path: Path, root: Path) -> list[list[Draw]]:
    """For each place what may be drawn there."""
    found = []
    name = str(path.relative_to(root))
    for number, start, code, part in statements(path):
        for column, old, choices, kind in changes(start, code, part):
            found.append([Draw(name, number, column, old, new, kind) for new in choices])
    return found


def statements(path: Path):
    """Lines with what can be drawn: number, first line of the statement, the line without texts and comments, where it begins."""
    start, goes_on = "", False
    for number, line in enumerate(path.read_text(encoding="utf-8").split("\n"), 1):
        code = without_texts(line)
        if not code.strip() or code.lstrip().startswith("#"):
            continue
        if not goes_on:
            start = code.strip()
        goes_on = code.rstrip().endswith("&")
        if DECLARATION.match(start):  # values alone
            at = code.find("=", max(code.find("::"), 0)) if "::" in code else 0 if "=" in start.split("::")[1] else -1
            if at >= 0 and "=>" not in code:
                yield number, start, code, at
        elif not HEADINGS.match(start):
            yield number, start, code, 0


def without_texts(line: str) -> str:
    """Blanks in the place of texts and comments."""
    inside, result = "", ""
    for letter in line:
        if inside:
            inside = "" if letter == inside else inside
            result += " "
        elif letter in "'\"":
            inside = letter
            result += " "
        elif letter == "!":
            break
        else:
            result += letter
    return result


def changes(start: str, code: str, begin: int):
    """What can be changed in a line: column, text, what may take its place, kind."""

    def each(pattern: str):
        return (match for match in re.finditer(pattern, code) if match.start(match.lastindex or 0) >= begin)

    swapped = {"+": "-", "-": "+", "*": "/", "/": "*"}
    for match in each(r"(?<=[\w)\]] )([+-])(?= )"):
        yield match.start(1), match[1], [swapped[match[1]]], "operator"
    for match in each(r"(?<=[\w)\] ])(?<![*/(])([*/])(?![*/=)])(?=[\w(\[ ])"):
        yield match.start(1), match[1], [swapped[match[1]]], "operator"
    for match in each(r"(?<=[=(,\[<>] |[\s=(,\[]\()(-)(?=[\w(])|(?<=[(,\[=])(-)(?=[\w(])"):
        at = match.start(match.lastindex)
        yield at, "-", [""], "sign"
    for match in each(r"(?<![\w=<>/*])= (?=[a-z(])"):  # a result with the other sign; does not build where it is not a number
        is_zero = not re.search(r"[^0. ,()]", re.sub(r"_wp", "", code[match.end() :]))  # has no other sign, nor has a NaN
        if (
            begin == 0
            and not (is_zero or "ieee_quiet_nan" in code)
            and not start.startswith(("do ", "if (", "allocate", "where", "forall", "call"))
            and "=>" not in code
        ):
            yield match.start(), "= ", ["= -"], "sign"
    relations = {"<": ["<=", ">"], ">": [">=", "<"], "<=": ["<", ">="], ">=": [">", "<="], "==": ["/="], "/=": ["=="]}
    for match in each(r"(?<= )(<=|>=|==|/=|<|>)(?= )"):
        yield match.start(1), match[1], relations[match[1]], "comparison"
    logic = {".and.": [".or."], ".or.": [".and."], ".not. ": [""], ".true.": [".false."], ".false.": [".true."]}
    for match in each(r"(\.and\.|\.or\.|\.not\. |\.true\.|\.false\.)"):
        yield match.start(1), match[1], logic[match[1]], "logic"
    pairs = ("min", "max"), ("minval", "maxval"), ("any", "all"), ("sin", "cos")
    others = {a: b for pair in pairs for a, b in (pair, pair[::-1])}
    for match in each(r"(?<![\w%])(min|max|minval|maxval|any|all|sin|cos)(?=\()"):
        yield match.start(1), match[1], [others[match[1]]], "operator"
    is_steering = "parameter" in start.split("::")[0] and "::" in start
    for match in each(NUMBER):
        if re.search(
            r"((kind|unit|len)\s*=\s*|\b(huge|tiny|epsilon|ieee_value)\()$", code[: match.start(1)]
        ):  # of these the kind counts
            continue
        yield match.start(1), match[1], other_numbers(match[1]), "steering constant" if is_steering else "constant"
    if begin == 0:
        for match in each(r"(?<=[\w)])(:)(?=[\w(])"):  # of a part of an array
            if "(" in code[: match.start(1)]:
                yield match.start(1), ":", [" + 1:", ":-1 + "], "bound"
        match = re.match(r"\s*(?:\w+: )?do (?:concurrent \()?\w+ = (.*?), (.*)", code)
        if match and code.count("(", 0, match.start(2)) == code.count(")", 0, match.start(2)):
            yield match.start(1), "", ["1 + "], "bound"
            yield match.start(2), "", ["-1 + "], "bound"


def other_numbers(text: str) -> list[str]:
    value, _, kind = text.partition("_")
    kind = f"_{kind}" if kind else ""
    if "." not in value:
        return [f"{int(value) + 1}{kind}"] + ([f"{int(value) - 1}{kind}"] if int(value) > 0 else [])
    number = float(value.replace("d", "e"))
    return [f"1.0{kind}"] if number == 0.0 else [f"{2.0 * number!r}{kind}", f"{0.5 * number!r}{kind}"]

"""Mutants of src/files."""

from mutant_parts.mutant import of

MUTANTS = [
    *of(
        "files/hb_reduction_file.f90",
        (
            "reduction_mark",
            "test_hb_reduction_file",
            "a reduction of something else is taken",
            "else if (any(of_file /= mark)) then",
            "else if (all(of_file /= mark) .and. size(mark) < 0) then",
        ),
        (
            "reduction_trouble",
            "test_hb_reduction_file",
            "nobody is told of a reduction that is of no use",
            'trouble = reduction_path(model, mark)//": "//error%message',
            "",
        ),
    ),
]

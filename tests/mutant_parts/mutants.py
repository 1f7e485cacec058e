"""All mutants, a module for each floor of src/."""

from mutant_parts import balance, extern, hypertime, laws, march, motion, solve, stability, structure, study

FLOORS = (balance, extern, hypertime, laws, march, motion, solve, stability, structure, study)
MUTANTS = [mutant for floor in FLOORS for mutant in floor.MUTANTS]

"""Designs and answers that tests write in one line."""

from stepblocks.study.design.read import SheetRow
from stepblocks.study.design.trials import design_trials
from stepblocks.study.experiments.registry import EXPERIMENTS


def lined(rows, file="answers.csv"):
    """Answers as they are read from a file, whose first line is the header."""
    return [SheetRow(row, file, number) for number, row in enumerate(rows, start=2)]


def crossed(experiment, participants, items, repetitions, seed, probes=()):
    """Every participant judges every block in every condition."""
    factors = {"probe": probes} if probes else EXPERIMENTS[experiment].factors
    return design_trials(experiment, participants, items, repetitions, seed, factors=factors)


def compared(participants, items, repetitions, seed, standard):
    """Every other block is compared with a standard, in both orders."""
    return design_trials(
        "constant", participants, items, repetitions, seed, factors={}, standard=standard
    )

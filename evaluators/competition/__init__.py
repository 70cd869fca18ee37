"""The scoring program of a competition and its page."""

from evaluators.competition.program import main as main

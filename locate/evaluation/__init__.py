"""A map against the truth of a simulated scene."""

from locate.evaluation.evaluation import Evaluation, evaluate_map

__all__ = ["Evaluation", "evaluate_map"]

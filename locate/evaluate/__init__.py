"""A map against the truth of a simulated scene."""

from locate.evaluate.evaluation import Evaluation, evaluate

__all__ = ["Evaluation", "evaluate"]

"""Estimates against the truth: association, alignment, pose errors, drift, landmarks, consistency, loop closures."""

from slamcli.evaluation.drift import Gap, dead_reckoning, gap
from slamcli.evaluation.evaluate import evaluate
from slamcli.evaluation.result import EstimateResult, EvaluateOptions, Evaluation

__all__ = ["EstimateResult", "EvaluateOptions", "Evaluation", "Gap", "dead_reckoning", "evaluate", "gap"]

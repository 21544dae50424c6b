"""The lines of results as types. From docs/reference/lines.schema.json, by scripts/result_types.py: change knothe/record/fields.cpp, not this."""
from __future__ import annotations

from typing import Any, TypedDict


class StepRecord(TypedDict, total=False):
    """A step's line of `knothe assimilate`."""

    step: int
    time: float
    wall_clock: str
    parameters: list[Any]
    mean: list[float]
    covariance: list[list[float]]
    maximum_a_posteriori: list[float]
    quantiles: dict[str, Any]
    method: str
    map_order: int
    variance_diagnostic: float
    tolerance_reached: bool
    ess: float
    verdict: dict[str, Any]
    trusted: bool
    log_evidence: float
    log_evidence_increment: float
    bias_correction: str
    used: int
    rejected: int
    missing: int
    elapsed_us: dict[str, Any]
    forecast: dict[str, Any]
    physical: dict[str, Any]
    decision: dict[str, Any]


class InferenceRecord(TypedDict, total=False):
    """The line of `knothe infer`."""

    method: str
    parameters: list[Any]
    wall_clock: str
    mean: list[float]
    covariance: list[list[float]]
    maximum_a_posteriori: list[float]
    quantiles: dict[str, Any]
    skewness: list[float]
    kurtosis: list[float]
    mean_error: float
    deviation_error: float
    map_order: int
    variance_diagnostic: float
    tolerance_reached: bool
    ess: float
    trusted: bool
    verdict: str
    edge_mass: list[float]
    log_evidence: float
    log_evidence_error: float
    model_evaluations: int
    model_calls: dict[str, Any]
    elapsed_us: dict[str, Any]
    samples_file: str
    distinct_draws: int
    physical: dict[str, Any]

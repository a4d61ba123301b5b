"""How many cases are tried, and how many were."""

import os

from hypothesis import HealthCheck, settings

# `make properties CASES=...` tries more.
CASES = int(os.environ.get("DOFSIM_CASES", "60"))
settings.register_profile(
    "dofsim",
    max_examples=CASES,
    deadline=None,
    # The same cases on every machine, unless more than usual are asked for.
    derandomize="DOFSIM_CASES" not in os.environ,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
)
settings.load_profile("dofsim")

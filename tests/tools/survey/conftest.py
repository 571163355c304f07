"""One survey for all tests: making it takes longer than looking at it."""

from __future__ import annotations

import pytest

from tests.tools.survey.made import surveyed
from tools.report.survey_view import SurveyView


@pytest.fixture(scope="package")
def view() -> SurveyView:
    """Two robots on 5 × 5 cells; the second dies, and for a while the base hears nobody."""
    return surveyed(5, 5, 2, deaths=((2, 100.0),), base_outages=((60.0, 120.0),))

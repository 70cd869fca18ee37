"""From figures to statements: intervals, tests, comparisons and figures by factor."""

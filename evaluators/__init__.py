"""Dataset and submission to scores and report."""

"""Consistency of the observer's covariance: `measures.py` measures it, `study.py` is the report."""

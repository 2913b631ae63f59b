"""The observer over recorded columns.

`batch.py` (the filter) and `smooth_batch.py` (with its smoother): the same kernels as live, so the
same bits.
"""

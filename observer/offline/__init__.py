"""The observer over recorded columns.

`batch.py` (the filter) and `smooth_batch.py` (with its smoother) use the same kernels as the live
observer, so the results have the same bits.
"""
